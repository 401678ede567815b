"""Image distance against metric distance, where both are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnilab.api import Parts, PathPoses, Series
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import heading_of
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_study
from omnilab_studies import Linearity
from omnilab_studies.common.tables import markdown
from omnilab_studies.descriptors.curves import Curve, lines_on_grid
from omnilab_studies.descriptors.figures import pareto_front

X = np.arange(1, 23) / 10


def curve(mean):
    return Curve(X, np.asarray(mean, float), np.zeros(22))


def grid_of(columns, rows, step=0.1):
    x, y = (a.ravel() for a in np.meshgrid(np.arange(columns), np.arange(rows)))
    return step * np.column_stack([x, y, np.zeros(len(x))])


# ----------------------------------------------------------------------------------------------------------- curves
@given(st.lists(st.floats(0.01, 100), min_size=22, max_size=22))
def test_the_line_is_that_of_least_squares(mean):
    found = curve(mean)
    (slope,), (residuals,), *_ = np.linalg.lstsq(X[:, None], found.mean, rcond=None)
    assert found.slope == pytest.approx(slope)
    assert found.r2_origin == pytest.approx(1 - residuals / np.sum(found.mean**2), abs=1e-9)
    if np.var(mean) > 1e-6:
        assert found.r2_centred == pytest.approx(1 - residuals / (22 * np.var(mean)), rel=1e-6, abs=1e-9)
    assert found.r2_centred <= found.r2_origin + 1e-12


def test_a_line_through_the_origin_is_explained_in_full():
    found = curve(3 * X)
    assert (found.slope, found.r2_centred, found.r2_origin) == pytest.approx((3, 1, 1))
    assert found.monotone_m == pytest.approx(2.2)
    assert found.relative.max() == 1


def test_the_range_of_monotony_ends_at_the_first_fall():
    assert curve(np.minimum(X, 2.4 - X)).monotone_m == pytest.approx(1.2)
    assert curve(np.minimum(X, 0.5)).monotone_m == pytest.approx(0.5)  # level is not rising
    assert curve(np.zeros(22)).monotone_m == 0


def test_a_flat_curve_explains_nothing():
    found = curve(np.zeros(22))
    assert (found.slope, found.r2_centred, found.r2_origin, found.spread) == (0, 0, 0, 0)
    assert curve(np.ones(22)).r2_centred == 0


def test_the_spread_is_relative():
    assert Curve(X, 4 * X, X**2).spread == pytest.approx(0.25)


# ------------------------------------------------------------------------------------------------------------ lines
@given(st.integers(1, 9), st.integers(1, 9), st.integers(3, 5), st.integers(0, 2**32 - 1))
def test_lines_are_whole_and_straight(columns, rows, count, seed):
    position_m = grid_of(columns, rows)
    if max(columns, rows) <= count:
        with pytest.raises(DataError, match="none of the"):
            lines_on_grid(position_m, 0.1, count / 10, 100, np.random.default_rng(seed))
        return
    lines = lines_on_grid(position_m, 0.1, count / 10, 100, np.random.default_rng(seed))
    assert len(lines) == 2 * (max(0, columns - count) * rows + max(0, rows - count) * columns)
    away = position_m[lines] - position_m[lines[:, :1]]
    assert np.allclose(np.linalg.norm(away, axis=-1), 0.1 * np.arange(count + 1))
    assert len(np.unique(lines, axis=0)) == len(lines)


def test_a_line_that_misses_a_node_is_left_out():
    position_m = np.delete(grid_of(5, 1), 2, axis=0)
    with pytest.raises(DataError, match="4 places has a line of 3 more places"):
        lines_on_grid(position_m, 0.1, 0.3, 1, np.random.default_rng(0))


def test_no_more_references_than_requested():
    lines = lines_on_grid(grid_of(9, 9), 0.1, 0.3, 5, np.random.default_rng(0))
    assert len(np.unique(lines[:, 0])) == 5


# ------------------------------------------------------------------------------------------------------------ study
@pytest.fixture
def parts(plain):
    return Parts(
        sensor=plain["Floor"](blocked=[[2.0, 1.0]]),
        descriptors={"painted": plain["Painted"](), "taught": plain["Taught"](3.0)},
        distances={"apart": plain["Apart"](), "squared": plain["Apart"](2.0)},
    )


SMALL = {"step_m": 0.2, "reach_m": 1.0, "references": 40, "show": 3}


def run(parts, record=None, **settings):
    study = Linearity(**{**SMALL, **settings})
    return study.run(parts, record or Recorder(), np.random.default_rng(0))


def test_what_is_known_comes_out(parts):
    report = run(parts)
    table = report.tables["linearity"]
    assert table["descriptor"] == ["painted", "painted", "taught", "taught"]
    assert table["slope_per_m"][0] == pytest.approx(60)
    assert table["slope_per_m"][2] == pytest.approx(180)  # what was taught is used
    x = np.arange(1, 6) / 5
    assert table["slope_per_m"][1] == pytest.approx(60**2 * np.sum(x**3) / np.sum(x**2))
    assert table["r2_centred"][0] == pytest.approx(1)
    assert table["r2_centred"][1] == pytest.approx(curve_of(x).r2_centred)
    assert table["monotone_m"] == [1.0] * 4
    assert table["bytes"] == [16.0] * 4
    assert table["parameters"][0] == "scale=1.0"
    metrics = {m.name: m.value for m in report.metrics}
    assert metrics["r2_best"] == pytest.approx(1)
    assert metrics["r2_painted_squared"] == table["r2_centred"][1]
    assert (metrics["contestants"], metrics["misfits"], metrics["left_out"]) == (4, 0, 1)
    assert len(report.tables["curves"]["mean"]) == 4 * 5
    assert max(report.tables["curves"]["variance"]) < 1e-4
    assert set(report.figures) == {"curves", "pareto"}


def curve_of(x):
    return Curve(x, x**2, np.zeros(5))


def test_what_does_not_fit_together_is_left_out_with_reasons(parts, plain):
    parts.descriptors["shifting"] = plain["Shifting"]()
    parts.distances.update(turning=plain["Turning"](), picky=plain["Picky"]())
    report = run(parts)
    names = list(zip(report.tables["linearity"]["descriptor"], report.tables["linearity"]["distance"], strict=True))
    assert [name for name in names if name[1] == "turning"] == [("shifting", "turning")]
    assert not [name for name in names if name[1] == "picky"]
    assert sum("looks for turns" in sentence for sentence in report.omitted) == 2
    assert sum("no two axes" in sentence for sentence in report.omitted) == 3
    assert {m.name: m.value for m in report.metrics}["misfits"] == 5


def test_nothing_that_fits(plain):
    parts = Parts(sensor=plain["Floor"](), descriptors={"a": plain["Painted"]()}, distances={"b": plain["Picky"]()})
    with pytest.raises(DataError, match="none of the distances can compare"):
        run(parts)


def test_lines_with_an_image_that_cannot_be_read_are_left_out(parts):
    clear = {m.name: m.value for m in run(parts).metrics}
    parts.sensor.unread = [3, 20]
    torn = run(parts)
    found = {m.name: m.value for m in torn.metrics}
    assert found["lines"] < clear["lines"]
    assert found["left_out"] == clear["left_out"] + 2
    assert torn.tables["linearity"]["slope_per_m"][0] == pytest.approx(60)


def test_random_headings_are_requested(parts):
    run(parts, random_headings=True)
    (turned,) = [layout for layout in parts.sensor.asked if isinstance(layout, PathPoses)]
    assert np.std(heading_of(turned.T_world_camera)) > 1


def test_curves_are_shown(parts):
    record = Kept()
    run(parts, record)
    shown = {path: r for path, r in record.records if isinstance(r, Series)}
    assert set(shown) == {f"curves/{d}/{m}" for d in ("painted", "taught") for m in ("apart", "squared")}
    assert list(shown["curves/painted/apart"].steps) == [20, 40, 60, 80, 100]
    assert np.allclose(shown["curves/painted/apart"].values, [0.2, 0.4, 0.6, 0.8, 1])


def test_it_keeps_the_contract(parts):
    check_study(Linearity(**SMALL), parts)


def test_disturbances_have_nothing_to_disturb(parts):
    parts.disturbances["blur"] = object()
    with pytest.raises(ConfigError, match="leave disturbance out"):
        run(parts)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"step_m": 0.0}, "step_m=0 "),
        ({"step_m": 1.0}, "at least 3 steps"),
        ({"references": 0}, "references=0"),
        ({"every": 0}, "every=0"),
        ({"show": -1}, "show=-1"),
        ({"extent_m": [1.0]}, r"extent_m=\[1.0\]"),
    ],
)
def test_bad_linearity_settings(settings, words):
    with pytest.raises(ConfigError, match=words):
        Linearity(**settings)


# ----------------------------------------------------------------------------------------------------------- charts
def test_the_pareto_front_is_what_none_beats():
    points = {"cheap": (1.0, 0.1), "best": (9.0, 0.9), "worse": (9.0, 0.8), "dear": (10.0, 0.9), "mid": (3.0, 0.5)}
    assert pareto_front(points) == ["cheap", "best", "mid"]


def test_a_table_as_markdown():
    assert markdown({"a_b": ["x", "y"], "c": [0.123456, 2]}) == "| a b | c |\n|---|---|\n| x | 0.1235 |\n| y | 2 |"


class Kept(Recorder):
    """Keeps what is logged."""

    def __init__(self):
        super().__init__()
        self.records = []

    def log(self, path, record, tick=None):
        self.records.append((path, record))

    def of(self, kind):
        return [record for _, record in self.records if isinstance(record, kind)]
