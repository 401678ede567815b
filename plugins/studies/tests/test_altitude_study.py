"""The study of relative altitude on a sensor whose pictures are their heights."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from omnilab.api import Circle, Frames, Heights, Image, Parts, PathPoses, Plan, RandomPoses, RecordedPoses, Series
from omnilab.cameras import ImageCircle
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import heading_of, planar_poses, wrap_angle
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_study
from omnilab_studies import Altitude
from omnilab_studies.altitude.results import HeightEstimates, sign_rate

CAMERA = ImageCircle(16, 16, Circle(7.5, 7.5, 8))


@dataclass
class Tower:
    """Pictures in the grey levels of 100 z and 40 h."""

    recorded_m: list[Any] | None = None  # [x, y, z] of what was recorded
    poses: bool = True
    torn: bool = False
    asked: list[Any] = field(default_factory=list)

    def plan(self, layout):
        self.asked.append(layout)
        if isinstance(layout, RandomPoses):
            rng = np.random.default_rng(layout.seed)
            T = planar_poses(np.column_stack([rng.uniform(0, 4, (layout.count, 2)), np.full(layout.count, 2.0)]))
        elif isinstance(layout, RecordedPoses):
            T = planar_poses(self.recorded_m)
        else:
            assert isinstance(layout, PathPoses)
            T = layout.T_world_camera
        return Plan([str(i) for i in range(len(T))], T if self.poses else None)

    def frames(self, plan):
        T = plan.T_world_camera
        images = np.zeros((len(T), 16, 16), np.uint8)
        images[:, 5, 0] = np.round(100 * T[:, 2, 3])
        images[:, 5, 1] = np.round(40 * np.mod(heading_of(T), 2 * np.pi))
        lost = ["3.png: torn"] if self.torn else []
        yield Frames(images, plan.keys, 10 * np.arange(len(T)), CAMERA, np.arange(len(T)), T, lost)

    def scene(self):
        return None


@dataclass
class Reads:
    """Reads the height back, in centimetres times `gain`; beyond `reach_m` it estimates nothing."""

    gain: float = 1.0
    reach_m: float = 10.0

    def relative(self, references, tests, camera):
        rise = tests[:, 5, 0].astype(float) - references[:, 5, 0]
        rotation = (tests[:, 5, 1].astype(float) - references[:, 5, 1]) / 40
        value = np.where(np.abs(rise) > 100 * self.reach_m, np.nan, self.gain * rise)
        curves = {"first": np.abs(np.arange(9) - rise[:, None]), "second": np.abs(np.arange(9) + rise[:, None])}
        return Heights(value, "cm", np.full(len(tests), 0.5), wrap_angle(rotation), curves)


@dataclass
class Push:
    """Makes the camera seem higher by `shift` centimetres."""

    shift: int = 0

    def apply(self, images, camera, rngs):
        assert len(rngs) == len(images)
        pushed = images.copy()
        pushed[:, 5, 0] += np.uint8(self.shift)
        return pushed


class Log(Recorder):
    """Keeps what is logged."""

    def __init__(self):
        super().__init__()
        self.logged = []

    def log(self, path, record, tick=None):
        self.logged.append((path, record, tick))


def parts_of(**changed):
    own = {"sensor": Tower(), "altimeters": {"good": Reads(), "short": Reads(2.0, 0.55)}}
    return Parts(**(own | changed))


def run(study, parts, record=None):
    return study.run(parts, record or Recorder(), np.random.default_rng(1))


def values(report):
    return {metric.name: metric.value for metric in report.metrics}


def test_the_contract():
    check_study(
        Altitude(position_count=2, heights_m=[0.9, 1.2, 0.1], references_m=[1.0], levels={"push": {"shift": [5]}}),
        parts_of(disturbances={"push": Push()}),
    )


def test_scores_are_those_that_arithmetic_gives():
    study = Altitude(position_count=3, levels={"push": {"shift": [15]}})
    report = run(study, parts_of(disturbances={"push": Push()}))
    found = values(report)
    assert [m.name for m in report.metrics][:2] == ["good_sign_clear", "short_sign_clear"]
    assert found["good_sign_clear"] == 1
    assert found["good_slope_clear_1_m"] == pytest.approx(100)
    assert found["good_r2_median_clear_1_m"] == pytest.approx(1)
    assert found["good_rms_m_clear_1_m"] == pytest.approx(0, abs=1e-9)
    assert found["good_spread_clear_0.1_m"] == pytest.approx(0, abs=1e-9)
    # 10 of 19 rises from 1.0 m, and 5 of 19 from 0.1 m, are within 0.55 m
    assert found["short_sign_clear"] == pytest.approx((10 + 5) / 38)
    # pushed up by 15 cm, a rise of -0.1 m looks like one of 0.05 m
    assert found["good_sign_rate_push_15_1_m"] == pytest.approx(18 / 19)
    assert found["good_bias_m_push_15_1_m"] == pytest.approx(0.15)
    assert found["good_rms_m_push_15_1_m"] == pytest.approx(0.15)
    table = report.tables["signs"]
    worst = [r for a, lv, rise, _, r in zip(*table.values(), strict=True) if (a, lv, rise) == ("good", "push 15", 0.1)]
    assert worst == [pytest.approx(2 / 3)]  # of -0.1 and 0.1 from 1.0 m, and 0.1 from 0.1 m
    assert set(report.figures) == {"estimates", "spread", "signs", "cost", "cases_good", "cases_short"}
    assert len(report.tables["estimates"]["value"]) == 2 * 2 * 2 * 3 * 20


@pytest.mark.slow
def test_cameras_are_rotated_and_rotations_scored():
    tower = Tower()
    report = run(Altitude(position_count=2), parts_of(sensor=tower))
    heading = heading_of(tower.asked[-1].T_world_camera)
    assert len(np.unique(heading.round(6))) == 40
    assert max(report.tables["altitude"]["rotation_error_median_deg"]) < 1.5
    run(Altitude(position_count=1, turned=False), parts_of(sensor=tower))
    assert np.ptp(heading_of(tower.asked[-1].T_world_camera)) == 0


@pytest.mark.slow
def test_the_first_column_is_shown_as_it_rises():
    log = Log()
    run(Altitude(position_count=2), parts_of(), log)
    steps = [tick.step for path, record, tick in log.logged if path == "query/image" and isinstance(record, Image)]
    assert steps == list(range(20))
    assert sum(path == "curves/good" for path, _, _ in log.logged) == 20
    rise = {path: record.values for path, record, _ in log.logged if isinstance(record, Series)}
    assert np.allclose(rise["rise/truth"], np.arange(1, 21) / 10 - 1)
    assert np.allclose(rise["rise/good"], rise["rise/truth"])


def recorded(*heights, x=0.0):
    return [[x, 0.0, z] for z in heights]


def test_recorded_columns_in_any_order_and_references_by_number():
    tower = Tower([*recorded(1.4, 1.25, 1.55, 1.7), *recorded(1.25, 1.4, x=1.0), *recorded(2.0, x=2.0)])
    study = Altitude(recorded=True, references_h=[1, 3])
    report = run(study, parts_of(sensor=tower))
    table = report.tables["estimates"]
    assert sorted(set(table["height_m"])) == [1.25, 1.4, 1.55, 1.7]
    assert set(table["reference"]) == {"h=1", "h=3"}
    assert values(report)["good_sign_clear"] == 1
    assert report.omitted == ["1 columns without the references h=1 and h=3"]


@pytest.mark.parametrize(
    ("tower", "settings", "sentence"),
    [
        (Tower(recorded(1.0, 1.2), poses=False), {}, "have no heights; name them"),
        (Tower(recorded(1.0, 1.0, 1.0)), {}, "has 3 images of one height"),
        (Tower(recorded(1.0)), {}, "is one image, and no other has more"),
        (Tower(recorded(1.0, 1.2)), {"references_m": [1.7]}, "references 1.7 m are not all in the column at .* 1, 1.2 m"),
        (Tower(recorded(1.0, 1.2)), {"references_h": [3]}, "references h=3 are not all in"),
        (Tower(recorded(1.0, 1.2), torn=True), {"references_h": [1]}, "lacks an image: 3.png: torn"),
    ],
)  # fmt: skip
def test_recordings_that_are_no_columns_are_refused(tower, settings, sentence):
    with pytest.raises(DataError, match=sentence):
        run(Altitude(recorded=True, **settings), parts_of(sensor=tower))


@pytest.mark.parametrize(
    "settings",
    [
        {"positions_m": []}, {"positions_m": [[1.0]]}, {"position_count": 0}, {"heights_m": [1.0, 0.5, 0.1]},
        {"references_m": []}, {"references_m": [1.0, 1.0]}, {"references_h": [0]}, {"range_m": 0.0},
        {"levels": {"push": {}}},
    ],
)  # fmt: skip
def test_settings_that_make_no_study_are_refused(settings):
    with pytest.raises(ConfigError, match=r"study\."):
        Altitude(**settings)


def test_a_study_without_an_altimeter_is_refused():
    with pytest.raises(ConfigError, match="give altimeter=NAME"):
        run(Altitude(), parts_of(altimeters={}))
    assert (
        values(run(Altitude(position_count=1), parts_of(altimeters={}, altimeter=Reads())))["altimeter_sign_clear"] == 1
    )


def test_a_silent_altimeter_has_no_line_and_no_sign():
    silent = Heights(np.full(3, np.nan), "px", np.zeros(3), np.zeros(3))
    estimates = HeightEstimates(0, np.arange(3.0), np.arange(3.0), silent, np.zeros(3))
    assert estimates.line(2.0) is None
    assert sign_rate(estimates.value, estimates.rise_m) == 0
