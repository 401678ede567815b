"""Cost, of parts whose bytes and rates are known."""

from __future__ import annotations

import numpy as np
import pytest

from omnilab.api import Parts
from omnilab.errors import ConfigError, DataError
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_study
from omnilab_studies import Cost


@pytest.fixture
def parts(plain):
    descriptors = {"painted": plain["Painted"](), "taught": plain["Taught"](2.0), "blind": plain["Blind"]()}
    own = dict.fromkeys(descriptors, plain["Apart"]())
    return Parts(sensor=plain["Floor"](), descriptors=descriptors, default_distances=own)


def run(parts, **settings):
    return Cost(**{"step_m": 0.5, "query_count": 60, **settings}).run(parts, Recorder(), np.random.default_rng(0))


def test_bytes_and_rates_are_metrics(parts):
    metrics = {m.name: m.value for m in run(parts).metrics}
    assert metrics["nearest_painted"] > 0.9  # grey levels are rounded
    assert metrics["nearest_taught"] == metrics["nearest_painted"]
    assert metrics["nearest_blind"] < 0.2
    assert metrics["bytes_painted"] == metrics["bytes_least"] == 16
    assert (metrics["places"], metrics["queries"]) == (9 * 7, 60)


def test_times_are_in_a_table(parts):
    table = run(parts).tables["times"]
    assert table["method"] == ["painted", "taught", "blind"]
    for name in ("view_ms", "describe_ms", "prepare_ms", "query_ms"):
        assert all(value > 0 for value in table[name])
    assert table["fit_s"][0] == 0 < table["fit_s"][1]
    total = np.array([table["view_ms"], table["describe_ms"], table["query_ms"]]).sum(axis=0)
    assert np.allclose(table["localise_ms"], total)
    assert table["parameters"] == ["scale=1.0", "scale=2.0", "scale=1.0"]


def test_every_image_is_described_once_after_a_warm_up(parts):
    counts = []
    descriptor = parts.descriptors["painted"]
    described = descriptor.describe
    descriptor.describe = lambda images: (counts.append(len(images)), described(images))[1]
    run(parts)
    assert counts[0] == 2
    assert sum(counts[1:]) == 9 * 7 + 60


def test_what_does_not_fit_is_left_out(parts, plain):
    parts.distances.update(apart=plain["Apart"](), picky=plain["Picky"](), turning=plain["Turning"]())
    report = run(parts)
    metrics = {m.name: m.value for m in report.metrics}
    assert (metrics["contestants"], metrics["misfits"]) == (4, 5)  # the blind one tells no distance from another
    assert set(report.figures) == {"times", "pareto"}


def test_nothing_to_measure(parts, plain):
    parts.distances.update(picky=plain["Picky"]())
    with pytest.raises(DataError, match="none of the distances can compare"):
        run(parts)


def test_a_cache_must_not_serve_it():
    assert Cost.cached is False


def test_it_keeps_the_contract_of_studies(parts):
    check_study(Cost(step_m=0.5, query_count=20), parts)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"every": 2}, "give one of them"),
        ({"step_m": -1.0}, "step_m=-1 "),
        ({"step_m": None, "every": 1}, "every=1 is out of range; give a whole number of 2 or more"),
        ({"query_count": 0}, "query_count=0"),
        ({"repeats": 0}, "repeats=0"),
        ({"extent_m": [1.0, -1.0]}, "extent_m="),
    ],
)
def test_bad_cost_settings(settings, words):
    with pytest.raises(ConfigError, match=words):
        Cost(**settings)
