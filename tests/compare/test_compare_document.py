"""`omnilab compare --json`: the numbers of the tables, as data."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from omnilab.api import Metric
from omnilab.runner.compare import compare_runs, comparison_document


def queries(errors, keys="abcd"):
    return {"query": range(4), "key": list(keys), "truth_x_m": [1.0, 2.0, 3.0, 4.0], "error_m": errors}


@pytest.fixture
def document(omnilab_here, made):
    """Two configurations with two seeds each, and a run that failed."""
    for seed in (0, 1):
        made(f"a{seed}", seed=seed, angles=45, rate=0.5 + seed / 10, queries=queries([1.0, 2.0, 4.0, ""]))
        made(f"b{seed}", seed=seed, angles=90, rate=0.7 + seed / 10, queries=queries([0.5, 2.0, 3.0, 1.0]))
    made("bad", status="failed")
    done = omnilab_here("compare", "a0", "a1", "b0", "b1", "bad", "--json")
    assert (done.rc, done.stderr) == (0, "")
    return json.loads(done.stdout)


def test_configurations_have_the_statistics_over_seeds(document):
    assert (document["format"], document["version"]) == ("omnilab-comparison", 1)
    assert document["settings"] == ["descriptor.angles"]
    first, second = document["configurations"]
    assert (first["name"], first["settings"], first["seeds"]) == ("A", {"descriptor.angles": "45"}, 2)
    rate = second["metrics"]["nearest_rate"]
    half = 12.706204736 * math.sqrt(0.005) / math.sqrt(2)  # Student's t of one degree of freedom
    assert rate["mean"] == pytest.approx(0.75)
    assert [rate["low"], rate["high"]] == pytest.approx([0.75 - half, 0.75 + half])
    assert (rate["n"], rate["interval"]) == (2, "Student's t over seeds")
    assert [run["configuration"] for run in document["runs"]] == ["A", "A", "B", "B"]
    assert [run["metrics"]["nearest_rate"] for run in document["runs"]] == pytest.approx([0.5, 0.6, 0.7, 0.8])
    assert [run["name"] for run in document["left_out"]] == ["bad"]


def test_pairs_and_curves_count_each_query(document):
    (pair,) = document["paired"]
    assert (pair["first"], pair["second"], pair["error"], pair["unit"], pair["seeds"]) == ("A", "B", "error_m", "m", 2)
    assert (pair["pairs"], pair["missing"], pair["won"], pair["tied"], pair["lost"]) == (6, 2, 4, 2, 0)
    assert pair["mean"] == pytest.approx(-0.5)
    first, second = document["error_curves"]["curves"]
    assert (first["configuration"], first["queries"], first["missing"]) == ("A", 8, 2)
    assert (second["queries"], second["missing"]) == (8, 0)
    assert document["error_curves"]["shares"] == list(range(101))
    assert second["quantiles"] == pytest.approx(np.percentile([0.5, 2, 3, 1] * 2, range(101)).tolist())


def test_every_cell_of_the_tables_is_in_the_document(omnilab_here, document):
    shown = omnilab_here("compare", "a0", "a1", "b0", "b1", "bad").stdout
    for configuration in document["configurations"]:
        for name, metric in configuration["metrics"].items():
            line = next(line for line in shown.splitlines() if line.split()[:1] == [name])
            assert metric["text"] in line
    for sentence in [*document["notes"], *document["meanings"]]:
        assert f"{sentence}." in shown


def test_what_has_no_value_is_null(made):
    first = made("a", angles=45, metrics=[Metric("recall", math.nan, "1", note="no query")])
    second = made("b", angles=90, metrics=[Metric("recall", 0.5, "1")])
    document = comparison_document(compare_runs([first, second]))
    recall = document["configurations"][0]["metrics"]["recall"]
    assert (recall["mean"], recall["std"], recall["low"], recall["n"]) == (None, None, None, 0)
    assert document["runs"][0]["metrics"] == {"recall": None}
    json.dumps(document, allow_nan=False)
