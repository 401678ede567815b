"""Localisation along a route: geometry, sets of places, and a drive whose errors are known."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnilab.api import Circle, Frames, Parts, Plan, Signatures
from omnilab.cameras import ImageCircle
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import planar_poses
from omnilab.testing import check_study
from omnilab_appearance import Euclidean, Nearest, RouteFilter
from omnilab_studies import RouteLocalization
from omnilab_studies.common.pose_sources import Source
from omnilab_studies.localization.route_localization.ambiguity import (
    left_out,
    nonconformity,
    place_sets,
    threshold,
    true_places,
)
from omnilab_studies.localization.route_localization.results import compass
from omnilab_studies.localization.route_localization.route import along_across, apart, arc_length, courses, filled
from omnilab_studies.localization.route_localization.study import QueryChoice


def test_courses_of_a_circle_are_its_tangents():
    turn = np.linspace(0, 2 * np.pi, 200)
    circle = np.column_stack([2 * np.cos(turn), 2 * np.sin(turn), np.zeros(200)])
    off = courses(circle, 0.2) - (turn + np.pi / 2)
    inner = np.rad2deg(np.angle(np.exp(1j * off)))[8:-8]
    assert np.abs(inner).max() < 0.05


def test_courses_are_unknown_where_there_are_none():
    x = np.array([0, 0.1, 0.2, 0.3, 2.0, 2.1, 2.2, np.nan, 2.3])
    line = np.column_stack([x, x * 0, x * 0])
    assert np.isnan(courses(line, 0.2)).tolist() == [False, False, False, True, True, False, False, True, False]
    assert np.isnan(courses(np.zeros((5, 3)), 0.2)).all()
    assert filled(np.array([np.nan, 1.0, np.nan, np.nan, 2.0])).tolist() == [1.0, 1.0, 1.0, 2.0, 2.0]
    assert filled(np.full(3, np.nan)).tolist() == [0, 0, 0]


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(-7, 7))
def test_errors_along_and_across_are_a_rotation(x, y, course):
    along, across = along_across(np.array([[x, y, 0.0]]), np.array([course]))
    assert along[0] ** 2 + across[0] ** 2 == pytest.approx(x**2 + y**2, abs=1e-9)
    ahead, left = along_across(np.array([[np.cos(course), np.sin(course), 0]]), np.array([course]))
    assert (ahead[0], left[0]) == pytest.approx((1, 0), abs=1e-9)


def test_places_apart_and_the_length_of_a_drive():
    line = np.column_stack([np.arange(7) * 0.3, np.zeros(7), np.zeros(7)])
    assert apart(line, 0.5).tolist() == [0, 2, 4, 6]
    assert arc_length(line)[-1] == pytest.approx(1.8)


def test_the_threshold_is_the_conformal_quantile():
    score = np.arange(1.0, 20)[:, None]
    assert threshold(score, np.ones((19, 1), bool), 0.95) == 19  # ceil(20 * 0.95) = 19th of 19
    assert threshold(score, np.ones((19, 1), bool), 0.9) == 18
    assert threshold(score[:18], np.ones((18, 1), bool), 0.95) == np.inf


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_sets_hold_the_truth_as_often_as_they_promise(seed):
    """Marginal coverage over exchangeable queries, of which the places' distances are any numbers at all."""
    rng = np.random.default_rng(seed)
    places_m = np.column_stack([np.arange(30.0), np.zeros(30), np.zeros(30)])
    truth_m = np.column_stack([rng.uniform(0, 29, 600), np.zeros(600), np.zeros(600)])
    field = np.abs(truth_m[:, :1] - places_m[None, :, 0]) ** 0.5 + rng.gamma(1.0, 0.5, (600, 30))
    true = true_places(truth_m, places_m, 1.0)
    largest = threshold(nonconformity(field[:300]), true[:300], 0.9)
    sets = place_sets(field[300:], largest, places_m, 3.0)
    assert (sets.member & true[300:]).any(axis=1).mean() > 0.9 - 0.09  # five standard deviations


def test_a_repeating_world_is_ambiguous_and_another_is_not():
    """Places that look the same every 10 are sets of several groups; the spread is said."""
    places_m = np.column_stack([np.arange(40.0), np.zeros(40), np.zeros(40)])
    for period, ambiguous in ((10, True), (40, False)):
        look = np.arange(40) % period
        between = np.abs(np.subtract.outer(look, look)).astype(float)
        between = np.minimum(between, period - between)
        largest = threshold(*left_out(between, places_m, 1.0), 0.95)
        sets = place_sets(between + 0.1, largest, places_m, 3.0)
        assert sets.ambiguous.all() == ambiguous
        assert sets.ambiguous.any() == ambiguous
        assert sets.member[np.arange(40), np.arange(40)].all()
    assert sets.extent_m.max() < 10


def test_the_compass_is_free_of_its_start():
    known = np.deg2rad(np.array([50.0, 60, 80, 80, 70]))
    found = compass("m", np.deg2rad([10.0, 20, 0, -10]), known)
    np.testing.assert_allclose(found.deviation_deg, 0, atol=1e-9)
    np.testing.assert_allclose(found.heading, known)
    assert np.isnan(compass("m", np.zeros(4), np.full(5, np.nan)).deviation_deg).all()


# ------------------------------------------------------------------------------------------------- a drive
@dataclass
class Drives:
    """Pictures whose grey is where they were taken: x along a line, y metres to its left."""

    y_m: float = 0.0
    known: bool = True

    def plan(self, layout):
        x = np.arange(31) * 0.1
        poses = planar_poses(np.column_stack([x, x * 0 + self.y_m, x * 0 + 1]))
        return Plan([f"{i}.png" for i in range(31)], poses if self.known else None)

    def frames(self, plan):
        x = np.array([0.1 * int(key.split(".")[0]) for key in plan.keys])
        images = np.tile((40 * x).round().astype(np.uint8)[:, None, None], (1, 32, 32))
        camera = ImageCircle(32, 32, Circle(15.5, 15.5, 15.5))
        yield Frames(images, plan.keys, np.arange(len(plan)), camera, np.arange(len(plan)), plan.T_world_camera)

    def scene(self):
        return None


@dataclass
class Grey:
    view = "mirror"
    rotation = "invariant"
    default_distance = "euclidean"
    color = False

    def describe(self, images):
        return Signatures(images.reshape(len(images), -1).mean(axis=1, dtype=np.float32)[:, None])


class Silent:
    """A recorder that keeps nothing."""

    def log(self, path, record, tick=None): ...

    def track(self, items, stage, total, size=len):
        yield from items

    def timed(self, stage, count=1):
        import contextlib

        return contextlib.nullcontext()


def run(study, **parts):
    given = {
        "sensor": Drives(),
        "descriptor": Grey(),
        "distance": Euclidean(),
        "localizers": {"n": Nearest(), "r": RouteFilter()},
    }
    report = study.run(Parts(**(given | parts)), Silent(), np.random.default_rng(0))
    return {metric.name: metric.value for metric in report.metrics}, report


def test_keeps_the_contract():
    parts = {"sensor": Drives(), "descriptor": Grey(), "distance": Euclidean(), "localizer": Nearest()}
    check_study(RouteLocalization(images=Source.recorded, every=3, show=2), Parts(**parts))


def test_errors_of_a_known_drive():
    metrics, report = run(
        RouteLocalization(images=Source.recorded, every=2, queries=QueryChoice.midway, confidence=0.8)
    )
    assert (metrics["places"], metrics["queries"]) == (16, 15)
    assert metrics["descriptor_n_position_error_median"] == pytest.approx(0.1, abs=1e-6)
    assert metrics["descriptor_r_position_error_median"] < 0.03
    assert metrics["descriptor_n_across_error_worst"] == pytest.approx(0, abs=1e-9)
    assert metrics["descriptor_set_coverage"] == 1
    assert metrics["descriptor_ambiguous_rate"] == 0
    assert set(report.figures) == {"route", "errors", "sets"}


def test_another_drive_beside_the_route_with_truth_of_some(tmp_path):
    (tmp_path / "truth.csv").write_text(
        "image,x_m,y_m\n" + "".join(f"{i}.png,{0.1 * i:.1f},0.3\n" for i in (4, 8, 12, 16))
    )
    study = RouteLocalization(
        images=Source.recorded, every=4, queries=QueryChoice.other, truth=str(tmp_path / "truth.csv"), confidence=0.5
    )
    metrics, report = run(study, sensors={"queries": Drives(0.3, known=False)})
    assert (metrics["queries"], metrics["queries_with_truth"]) == (31, 4)
    assert metrics["descriptor_n_across_error_median"] == pytest.approx(0.3)
    assert metrics["descriptor_n_along_error_median"] == pytest.approx(0, abs=1e-9)
    assert len(report.tables["queries"]["query"]) == 62


def test_what_cannot_be_is_a_sentence(tmp_path):
    (tmp_path / "truth.csv").write_text("image,x_m,y_m\nelse.png,0,0\n")
    for study, parts, sentence in (
        (RouteLocalization(images=Source.recorded, every=40), {}, "of the 31 images of the route 1 is a place"),
        (RouteLocalization(images=Source.recorded, every=1), {}, "all 31 images of the route are places"),
        (RouteLocalization(images=Source.recorded), {"sensor": Drives(known=False)}, "the images of the route have no positions"),
        (RouteLocalization(images=Source.recorded, queries=QueryChoice.other, truth=str(tmp_path / "truth.csv")), {"sensors": {"queries": Drives(0, False)}}, "names none of the queries"),
        (RouteLocalization(images=Source.recorded, queries=QueryChoice.other), {"sensors": {"queries": Drives(0, False)}}, "give a positions file, or study.truth=FILE"),
    ):  # fmt: skip
        with pytest.raises(DataError, match=sentence):
            run(study, **parts)
    with pytest.raises(ConfigError, match="needs the sensor of another drive; give"):
        run(RouteLocalization(images=Source.recorded, queries=QueryChoice.other))
    with pytest.raises(ConfigError, match="makes no use of the sensor of another drive"):
        run(RouteLocalization(images=Source.recorded), sensors={"queries": Drives()})
    with pytest.raises(ConfigError, match="give one of the two and null for the other"):
        RouteLocalization(images=Source.recorded, step_m=1.0)
    with pytest.raises(ConfigError, match=r"give study.queries=other, or leave them out"):
        RouteLocalization(images=Source.recorded, truth="x.csv")
    with pytest.raises(ConfigError, match="none is chosen; give localizer=NAME"):
        run(RouteLocalization(images=Source.recorded), localizers={})
