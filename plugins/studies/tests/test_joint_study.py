"""Position and height at once, in a world where both are painted into the image."""

from dataclasses import dataclass

import numpy as np
import pytest

from omnilab.api import Circle, Estimates, Frames, GridPoses, Heights, Match, Parts, Plan, RandomPoses, Signatures
from omnilab.cameras import ImageCircle
from omnilab.errors import ConfigError
from omnilab.geometry import planar_poses
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_study
from omnilab_studies import Joint

CAMERA = ImageCircle(16, 16, Circle(7.5, 7.5, 8))


@dataclass
class Tower:
    """A floor of 4 x 4 m; the image at (x, y, z) holds the grey levels of 20 x, 20 y, 100 z."""

    def plan(self, layout):
        if isinstance(layout, GridPoses):
            axis = np.arange(0, 4 + 1e-9, layout.step_m)
            x, y = (a.ravel() for a in np.meshgrid(axis, axis))
        else:
            assert isinstance(layout, RandomPoses)
            x, y = np.random.default_rng(layout.seed).uniform(0, 4, (2, layout.count))
        T = planar_poses(np.column_stack([x, y, np.full(len(x), layout.height_m)]))
        return Plan([str(i) for i in range(len(x))], T)

    def frames(self, plan):
        for start in range(0, len(plan), 7):
            part = np.arange(start, min(start + 7, len(plan)))
            T = plan.T_world_camera[part]
            images = np.zeros((len(part), 16, 16), np.uint8)
            images[:, 5, 3:6] = np.round(T[:, :3, 3] * [20, 20, 100])
            yield Frames(images, [plan.keys[i] for i in part], part * 10, CAMERA, part, T)

    def scene(self):
        return None


@dataclass
class Read:
    """Reads the position in the plan."""

    view, color, rotation, default_distance = "mirror", False, "invariant", "apart"

    def describe(self, images):
        return Signatures(images[:, 5, 3:5].astype(np.float32))


@dataclass
class Apart:
    def prepare(self, places):
        return places.place

    def match(self, queries, index):
        return Match(np.linalg.norm(queries.place[:, None] - index[None], axis=-1).astype(np.float32))


@dataclass
class Best:
    def prepare(self, places, distance):
        return places, distance, distance.prepare(places.signatures)

    def locate(self, queries, index):
        places, distance, prepared = index
        match = distance.match(queries, prepared)
        best = match.distance.argmin(axis=1)
        return Estimates(best, match.distance.min(axis=1), places.T_world_camera[best, :3, 3], None, match.distance)


@dataclass
class Gauge:
    """Reads the height, in units of its own."""

    unit: str = "hands"
    factor: float = 0.1

    def relative(self, references, tests, camera):
        assert len(references) == len(tests)
        rise = tests[:, 5, 5].astype(float) - references[:, 5, 5]
        return Heights(self.factor * rise, self.unit, np.ones(len(tests)), np.zeros(len(tests)))


def parts(**changed):
    return Parts(
        **{
            "sensor": Tower(),
            "descriptor": Read(),
            "distance": Apart(),
            "localizer": Best(),
            "altimeter": Gauge(),
            **changed,
        }
    )


def run(study, **changed):
    report = study.run(parts(**changed), Recorder(), np.random.default_rng(1))
    return report, {metric.name: metric.value for metric in report.metrics}


def test_keeps_the_contract():
    check_study(Joint(query_count=9, step_m=1.0), parts())


def test_a_perfect_altimeter_is_perfect_in_any_unit():
    report, metrics = run(Joint(query_count=20, step_m=1.0))
    assert metrics["sign_rate"] == 1
    assert metrics["height_error_median"] < 0.005
    assert metrics["scale"] == pytest.approx(0.1, rel=1e-3)  # ten grey levels a hand, a hundred a metre
    assert metrics["nearest_rate"] > 0.9
    rows = report.tables["joint"]
    assert np.allclose(rows["estimate_median_m"], rows["offset_m"], atol=0.006)
    assert len(report.tables["queries"]["rise_m"]) == 8 * 20
    assert "joint" in report.figures


def test_metres_are_not_scaled():
    _, metrics = run(Joint(query_count=10, step_m=1.0), altimeter=Gauge("m", 0.02))
    assert "scale" not in metrics
    assert metrics["height_error_median"] > 0.05  # it estimates twice the height


def test_queries_without_an_estimate_are_counted():
    report, metrics = run(Joint(query_count=10, step_m=1.0), altimeter=Gauge("m", float("nan")))
    assert np.isnan(metrics["height_error_median"])
    assert metrics["sign_rate"] == 0
    assert report.tables["joint"]["not_estimated"] == [10] * 8


@pytest.mark.parametrize(
    "settings", [{"step_m": 0.0}, {"query_count": 0}, {"offsets_m": []}, {"offsets_m": [-0.6]}, {"extent_m": [1.0]}]
)
def test_settings_that_make_no_study_are_refused(settings):
    with pytest.raises(ConfigError, match=r"study\."):
        Joint(**settings)
