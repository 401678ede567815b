"""The grid study on worlds so plain that its figures are known beforehand."""

from dataclasses import dataclass

import numpy as np
import pytest

from omnilab.api import Circle, Estimates, Frames, GridPoses, Parts, Plan, RandomPoses, RecordedPoses, Signatures
from omnilab.cameras import ImageCircle
from omnilab.errors import ConfigError, DataError, PluginError
from omnilab.geometry import heading_of, planar_poses
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_study
from omnilab_studies import Grid
from omnilab_studies.localization.grid.study import Queries

CAMERA = ImageCircle(16, 16, Circle(7.5, 7.5, 8))


@dataclass
class Plane:
    """A world whose image at (x, y), heading h, is painted in the grey levels of 20 x, 20 y and 256 h / 2 pi."""

    poses: bool = True

    def plan(self, layout):
        if isinstance(layout, GridPoses):
            axis = np.arange(0, 4 + 1e-9, layout.step_m or 2.0)
            x, y = (a.ravel() for a in np.meshgrid(axis, axis))
            heading = np.zeros_like(x)
        elif isinstance(layout, RandomPoses):
            rng = np.random.default_rng(layout.seed)
            x, y = rng.uniform(0, 4, (2, layout.count))
            heading = rng.uniform(-np.pi, np.pi, layout.count)
        else:
            assert isinstance(layout, RecordedPoses)
            x, y, heading = np.array([0.9, 2.0]), np.array([0.2, 1.0]), np.zeros(2)
        T = planar_poses(np.stack([x, y, np.ones_like(x)], -1), heading)
        return Plan([f"{i}" for i in range(len(x))], T if self.poses else None, ["(9, 9): inside 'box'"])

    def frames(self, plan):
        for start in range(0, len(plan), 7):
            part = np.arange(start, min(start + 7, len(plan)))
            T = planar_poses(np.zeros((len(plan), 3))) if plan.T_world_camera is None else plan.T_world_camera
            values = np.stack([20 * T[part, 0, 3], 20 * T[part, 1, 3], np.mod(heading_of(T[part]), 2 * np.pi) * 40], -1)
            images = np.zeros((len(part), 16, 16), np.uint8)
            images[:, 5, :3] = np.round(values)
            poses = None if plan.T_world_camera is None else T[part]
            yield Frames(images, [plan.keys[i] for i in part], part * 10, CAMERA, part, poses)

    def scene(self):
        return None


@dataclass
class Read:
    """Reads the levels back."""

    view = "mirror"
    color = False
    rotation = "none"
    default_distance = "euclidean"

    def describe(self, images):
        return Signatures(images[:, 5, :3].astype(np.float32))


@dataclass
class Levels:
    """Compares the levels of the positions, and subtracts those of the headings."""

    def prepare(self, places):
        return places.place

    def match(self, queries, index):
        from omnilab.api import Match

        apart = queries.place[:, None] - index[None]
        return Match(np.linalg.norm(apart[..., :2], axis=-1).astype(np.float32), apart[..., 2] / 40)


@dataclass
class Best:
    """The nearest place, or (on request) one that is off."""

    off: int = 0
    field: bool = True

    def prepare(self, places, distance):
        return places, distance, distance.prepare(places.signatures)

    def locate(self, queries, index):
        places, distance, prepared = index
        match = distance.match(queries, prepared)
        best = np.argsort(match.distance, axis=1, kind="stable")[:, self.off]
        every = np.arange(len(best))
        return Estimates(
            best,
            match.distance[every, best],
            places.T_world_camera[best, :3, 3],
            match.rotation_rad[every, best],
            match.distance if self.field else None,
        )


def _run(study, **changed):
    parts = Parts(**{"sensor": Plane(), "descriptor": Read(), "distance": Levels(), "localizer": Best(), **changed})
    report = study.run(parts, Recorder(), np.random.default_rng(1))
    return report, {metric.name: metric.value for metric in report.metrics}


def test_keeps_the_contract():
    parts = Parts(sensor=Plane(), descriptor=Read(), distance=Levels(), localizer=Best())
    check_study(Grid(step_m=1.0, query_count=20), parts)


def test_a_perfect_method_is_perfect():
    report, metrics = _run(Grid(step_m=0.5, query_count=60))
    assert metrics["nearest_rate"] > 0.9  # grey levels are a twentieth of a metre
    assert metrics["wrong_rate"] == 0
    assert metrics["position_error_p95"] < 0.5 * 0.5 * np.sqrt(2) + 0.05
    assert metrics["heading_error_p95"] < np.rad2deg(1 / 40)
    assert metrics["places"] == 81
    assert metrics["queries"] == 60
    assert metrics["left_out"] == 1
    assert metrics["bytes_per_place"] == 12
    assert set(report.figures) == {"success", "error_map", "distance_surface", "worst", "recall"}
    assert max(report.tables["queries"]["rank"]) <= 2


def test_the_fourth_best_place_is_never_nearest_or_second_but_by_ties():
    _, metrics = _run(Grid(step_m=1.0, query_count=60), localizer=Best(off=6))
    assert metrics["nearest_rate"] == 0
    assert metrics["wrong_rate"] > 0.9


def test_recorded_queries_by_hand():
    report, metrics = _run(Grid(step_m=None, every=2, queries=Queries.rest))
    table = report.tables["queries"]
    assert table["verdict"] == ["nearest", "nearest"]
    assert np.allclose(table["error_m"], [np.hypot(0.9, 0.2), 1.0])
    assert table["rank"] == [1, 1]  # (2, 1) lies half-way between (2, 0) and (2, 2): either is nearest
    assert metrics["places"] == 9


def test_a_localizer_without_fields_or_a_study_without_pictures_leaves_those_out():
    report, metrics = _run(Grid(step_m=1.0, query_count=10, show=0), localizer=Best(field=False))
    assert "sharpness_mean" not in metrics
    assert "distance_surface" not in report.figures


def test_a_sensor_without_positions_is_refused():
    with pytest.raises(DataError, match="no positions"):
        _run(Grid(), sensor=Plane(poses=False))


@pytest.mark.parametrize(
    "settings",
    [
        {"step_m": None},
        {"step_m": 0.2, "every": 2},
        {"step_m": 0.0},
        {"step_m": float("nan")},
        {"step_m": None, "every": 0},
        {"query_count": 0},
        {"extent_m": [1.0]},
    ],
)
def test_settings_that_make_no_study_are_refused(settings):
    with pytest.raises(ConfigError, match=r"study\."):
        Grid(**settings)


def test_an_image_that_a_descriptor_fails_on_is_named_by_its_key():
    class Broken(Read):
        def describe(self, images):
            error = PluginError("NaN in image number 2")
            error.item = 2
            raise error

    with pytest.raises(PluginError, match=r"^NaN in image number 2 \(image number 2 is 2\)$"):
        _run(Grid(step_m=1.0, query_count=5), descriptor=Broken())
