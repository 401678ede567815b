"""Robustness and resolution on a plane so plain that the rates are known beforehand."""

from dataclasses import dataclass

import numpy as np
import pytest

from omnilab.api import (
    Circle,
    DistanceField,
    Estimate,
    Estimates,
    Frames,
    GridPoses,
    Match,
    Parts,
    PathPoses,
    Plan,
    RandomPoses,
    Signatures,
)
from omnilab.cameras import ImageCircle
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import heading_of, planar_poses, wrap_angle
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_study
from omnilab_studies import Resolution, Robustness
from omnilab_studies.common.disturbance_levels import levels_of
from omnilab_studies.common.free_area import free_square

CAMERA = ImageCircle(16, 16, Circle(7.5, 7.5, 8))
LEVELS_PER_M = 40


@dataclass
class Plane:
    """An image at (x, y), heading h, is painted in the grey levels of 40 x + 40, 40 y + 40 and 40 h."""

    hole: bool = False  # furniture around (0.5, 0.5)

    def plan(self, layout):
        if isinstance(layout, GridPoses):
            axis = np.arange(-1, 3 + 1e-9, layout.step_m)
            x, y = (a.ravel() for a in np.meshgrid(axis, axis))
            T = planar_poses(np.stack([x, y, np.ones_like(x)], -1))
            free = ~(self.hole & (np.hypot(x - 0.5, y - 0.5) < 0.1))
            return Plan([f"{i}" for i in np.flatnonzero(free)], T[free])
        if isinstance(layout, RandomPoses):
            at = np.random.default_rng(layout.seed).uniform(-1, 3, (layout.count, 2))
            layout = PathPoses(planar_poses(np.column_stack([at, np.ones(layout.count)])))
        assert isinstance(layout, PathPoses)
        return Plan([f"query {i}" for i in range(len(layout.T_world_camera))], layout.T_world_camera)

    def frames(self, plan):
        for start in range(0, len(plan), 70):
            part = np.arange(start, min(start + 70, len(plan)))
            T = plan.T_world_camera[part]
            heading = np.mod(heading_of(T), 2 * np.pi)
            levels = np.stack([T[:, 0, 3] + 1, T[:, 1, 3] + 1, heading], -1) * LEVELS_PER_M
            images = np.zeros((len(part), 16, 16), np.uint8)
            images[:, 5, :3] = np.round(levels)
            yield Frames(images, [plan.keys[i] for i in part], part * 10, CAMERA, part, T)

    def scene(self):
        return None


@dataclass
class Read:
    """Reads the levels back, in steps: `parts` of 256 levels, `angles` of a turn."""

    parts: int = 256
    angles: int = 360

    view = "mirror"
    color = False
    rotation = "none"
    default_distance = "euclidean"

    def describe(self, images):
        levels = images[:, 5, :3].astype(np.float32)
        coarse = 256 / self.parts
        levels[:, :2] = np.floor(levels[:, :2] / coarse) * coarse
        levels[:, 2] = np.round(levels[:, 2] / LEVELS_PER_M / (2 * np.pi) * self.angles)
        levels[:, 2] *= 2 * np.pi / self.angles
        return Signatures(levels)


@dataclass
class Levels:
    """Compares the levels of the positions, and subtracts the headings."""

    def prepare(self, places):
        return places.place

    def match(self, queries, index):
        apart = queries.place[:, None] - index[None]
        return Match(np.linalg.norm(apart[..., :2], axis=-1).astype(np.float32), wrap_angle(apart[..., 2]))


@dataclass
class Blind(Levels):
    """Tells nothing apart, and no rotation."""

    def match(self, queries, index):
        return Match(np.zeros((len(queries), len(index)), np.float32))


@dataclass
class Best:
    """The nearest place."""

    def prepare(self, places, distance):
        return places, distance, distance.prepare(places.signatures)

    def locate(self, queries, index):
        places, distance, prepared = index
        match = distance.match(queries, prepared)
        best = match.distance.argmin(axis=1)
        every = np.arange(len(best))
        heading = None if match.rotation_rad is None else match.rotation_rad[every, best]
        position_m = places.T_world_camera[best, :3, 3]
        return Estimates(best, match.distance[every, best], position_m, heading, match.distance)


@dataclass
class Push:
    """Paints x, and with it the query, by some levels further right."""

    shift: int = 0
    seen: int = 1

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
    own = {
        "sensor": Plane(), "localizer": Best(), "descriptor": Read(), "distance": Levels(),
        "descriptors": {"read": Read(), "blind": Read()}, "disturbances": {"push": Push(), "none": Push()},
        "default_distances": {"read": Levels(), "blind": Blind()},
    }  # fmt: skip
    return Parts(**(own | changed))


def values(report):
    return {metric.name: metric.value for metric in report.metrics}


SQUARE = {"side": 4, "step_m": 0.5}
PUSHED = Robustness(**SQUARE, query_count=600, levels={"push": {"shift": [5, 20]}})


def test_both_keep_the_contract():
    check_study(Robustness(**SQUARE, query_count=90, levels={"push": {"shift": [5, 20]}}), parts_of())
    check_study(Resolution(**SQUARE, query_count=90, settings=["parts", "angles"], sizes=[[256, 8]]), parts_of())


def test_a_heading_error_that_nothing_can_give_says_why():
    class Flat(Levels):
        """The same distance to all places."""

        def match(self, queries, index):
            found = super().match(queries, index)
            return Match(np.ones_like(found.distance), np.zeros_like(found.distance))

    parts = parts_of(default_distances={"read": Flat(), "blind": Blind()})
    study = Robustness(**SQUARE, query_count=9, levels={"push": {"shift": [5]}})
    found = {metric.name: metric for metric in study.run(parts, Recorder(), np.random.default_rng(3)).metrics}
    assert found["read_clear_rate"].value == 0
    assert np.isnan(found["read_heading_error_median"].value)
    assert found["read_heading_error_median"].note == "nothing tells any answer from other places"


def test_rates_areas_and_breakdowns_are_those_that_geometry_gives():
    report = PUSHED.run(parts_of(), Recorder(), np.random.default_rng(3))
    rows = {(c, d, level): i for i, (c, d, level) in enumerate(zip(
        *(report.tables["levels"][key] for key in ("method", "disturbance", "level")), strict=True))}  # fmt: skip
    nearest = np.array(report.tables["levels"]["nearest_rate"])
    # nodes every 20 levels, and queries between the first and the last: pushed by a quarter of a cell a quarter of each
    # cell but the last answers the next node, pushed by a whole cell only the right half of the last cell stays
    by_hand = {("clear", ""): 1.0, ("push", 5): 0.75, ("push", 20): 1 / 6, ("none", "as set"): 1.0}
    for (disturbance, level), rate in by_hand.items():
        assert nearest[rows["read", disturbance, level]] == pytest.approx(rate, abs=0.07)  # four standard deviations
    found = values(report)
    pushed = [nearest[rows["read", "push", level]] for level in (5, 20)]
    assert found["read_area_push"] == pytest.approx(np.mean(pushed))
    assert found["read_area"] == pytest.approx((np.mean(pushed) + nearest[rows["read", "none", "as set"]]) / 2)
    assert report.tables["robustness"]["breakdown_push"] == [20, ""]  # blind guesses are as good pushed as clear
    assert report.tables["robustness"]["breakdown_none"] == ["", ""]
    assert found["blind_clear_rate"] == pytest.approx(1 / 36, abs=0.03)  # the corner's quarter cell, of 3 x 3 cells
    assert found["blind_sharpness_mean"] == 0
    assert "blind_heading_error_median" not in found
    assert found["read_heading_error_median"] < np.rad2deg(1 / LEVELS_PER_M)
    assert set(report.figures) == {"pictures", "rates", "sharpness", "surfaces", "pareto"}


def test_every_level_has_the_same_queries_and_is_shown():
    log = Log()
    report = PUSHED.run(parts_of(), log, np.random.default_rng(3))
    shown = [(record, tick.step) for path, record, tick in log.logged if path == "estimate/read"]
    assert [step for _, step in shown] == [0, 1, 2, 3]
    assert len({tuple(record.truth_m) for record, _ in shown}) == 1
    assert all(isinstance(record, Estimate) for record, _ in shown)
    again = PUSHED.run(parts_of(disturbances={"push": Push()}), Recorder(), np.random.default_rng(3))
    assert report.tables["levels"]["nearest_rate"][:6] == again.tables["levels"]["nearest_rate"][:6]
    assert not any(isinstance(record, DistanceField) for _, record, _ in log.logged)


def test_levels_of_a_disturbance_that_is_not_there_are_reported_as_unused():
    log = Log()
    study = Robustness(**SQUARE, query_count=5, levels={"blur": {"sigma": [1]}})
    study.run(parts_of(), log, np.random.default_rng(0))
    assert any("study.levels.blur is not used" in getattr(record, "text", "") for _, record, _ in log.logged)


def test_without_a_side_the_map_is_all_that_is_free():
    parts = parts_of(sensor=Plane(hole=True))
    study = Robustness(side=None, step_m=0.5, query_count=60, levels={"push": {"shift": [5]}})
    report = study.run(parts, Recorder([]), np.random.default_rng(0))
    assert set(report.tables["levels"]["queries"]) == {60}
    summary = report.tables["robustness"]
    rates = dict(zip(summary["method"], summary["clear_rate"], strict=True))
    assert rates["read"] > 0.9  # a query by the furniture may be nearer to it than to what is free
    assert rates["blind"] < 0.1
    mesh = np.ma.filled(report.figures["surfaces"].axes[0].collections[0].get_array().astype(float), np.nan)
    x = np.arange(-1, 3.1, 0.5)
    assert np.argwhere(np.isnan(mesh)).tolist() == [[np.searchsorted(x, 0.5), np.searchsorted(x, 0.5)]]  # furniture


def test_corrections_follow_every_level_and_are_none():
    first, second = Push(), Push()
    found = levels_of({"push": {"shift": [1, 2]}}, {"push": first, "back": second}, Log(), ["back"])
    assert [level.title for level in found] == ["clear", "push 1", "push 2"]
    assert [list(level.applied) for level in found] == [["back"], ["push", "back"], ["push", "back"]]
    with pytest.raises(
        ConfigError, match=r"study.corrections names 'bakc', which is no disturbance.*did you mean back"
    ):
        levels_of({}, {"back": second}, Log(), ["bakc"])


@pytest.mark.parametrize(
    "settings",
    [
        {"side": 1}, {"step_m": 0.0}, {"step_m": float("nan")}, {"center_m": [1.0]}, {"query_count": 0},
        {"heading_steps": 0}, {"levels": {"push": {}}}, {"levels": {"push": {"shift": []}}},
        {"levels": {"push": {"shift": ["much"]}}}, {"levels": {"push": {"shift": [1], "seen": [1]}}},
    ],
)  # fmt: skip
def test_settings_that_make_no_robustness_study_are_refused(settings):
    with pytest.raises(ConfigError, match=r"study\."):
        Robustness(**settings)


def test_a_level_of_no_setting_is_refused_with_a_suggestion():
    study = Robustness(**SQUARE, query_count=5, levels={"push": {"shfit": [1]}})
    with pytest.raises(ConfigError, match=r"study\.levels\.push varies 'shfit'.*did you mean.*shift"):
        study.run(parts_of(), Recorder(), np.random.default_rng(0))


def test_the_map_is_the_free_square_nearest_to_the_centre():
    whole = free_square(Plane(), 4, 0.5, [0.75, 0.75], None)
    assert np.allclose(whole.T_world_camera[:, :2, 3].mean(axis=0), 0.75)
    assert np.allclose(whole.T_world_camera[:5, 0, 3], [0, 0.5, 1.0, 1.5, 0])  # row by row, x fastest
    around = free_square(Plane(hole=True), 3, 0.5, [0.5, 0.5], None).T_world_camera[:, :2, 3]
    assert len(np.unique(around, axis=0)) == 9
    assert np.hypot(*(around - 0.5).T).min() > 0.1
    assert np.isclose(np.linalg.norm(around.mean(axis=0) - 0.5), 1.0)  # two nodes aside
    with pytest.raises(DataError, match="no 20 x 20 free places"):
        free_square(Plane(), 20, 0.5, [0, 0], None)


def test_resolution_by_hand():
    sizes = [[256, 360], [64, 8], [16, 8], [4, 8]]  # 4 parts: steps of 64 levels, in which nodes 20 apart run together
    study = Resolution(**SQUARE, center_m=[0.75, 0.75], query_count=500, settings=["parts", "angles"], sizes=sizes)
    report = study.run(parts_of(), Recorder(), np.random.default_rng(5))
    table, found = report.tables["resolution"], values(report)
    assert table["size"] == 2 * ["256 x 360", "64 x 8", "16 x 8", "4 x 8"]
    assert table["headings"] == 4 * ["on_grid"] + 4 * ["any"]
    assert table["bytes_per_place"] == 8 * [12.0]
    nearest = dict(zip(zip(table["size"], table["headings"], strict=True), table["nearest_rate"], strict=True))
    for headings in ("on_grid", "any"):
        assert nearest["256 x 360", headings] > 0.95
        assert nearest["4 x 8", headings] < 0.5
        smallest = f"{found[f'smallest_parts_distance_{headings}']} x {found[f'smallest_angles_distance_{headings}']}"
        enough = [
            size for (size, h), rate in nearest.items() if h == headings and rate >= nearest["256 x 360", h] - 0.01
        ]
        assert smallest == enough[-1]  # they are listed from the largest to the smallest
    # 8 angles: none off the grid on it, evenly within half of 45 degrees beside it
    assert found["heading_error_median_64x8_distance_on_grid"] == pytest.approx(0, abs=1e-3)
    assert found["heading_error_median_64x8_distance_any"] == pytest.approx(45 / 4, abs=1.5)


def test_all_sizes_have_queries_at_the_same_positions():
    sizes = [[256, 8], [256, 4]]
    study = Resolution(**SQUARE, query_count=300, settings=["parts", "angles"], sizes=sizes)
    found = values(study.run(parts_of(), Recorder(), np.random.default_rng(5)))
    rates = {value for name, value in found.items() if name.startswith("nearest_rate")}
    assert len(rates) == 1, "positions decide alone, and are the same for both sizes and both kinds of headings"


@pytest.mark.parametrize(
    "settings",
    [
        {"settings": ["offsets"]},
        {"sizes": []},
        {"sizes": [[1]]},
        {"sizes": [[0, 4]]},
        {"sizes": [[4, 4], [4, 4]]},
        {"query_count": 0},
    ],
)
def test_settings_that_make_no_resolution_study_are_refused(settings):
    with pytest.raises(ConfigError, match=r"study\."):
        Resolution(**settings)


def test_a_size_of_no_setting_is_refused_with_a_suggestion():
    with pytest.raises(ConfigError, match=r"'angels'.*did you mean.*angles"):
        Resolution(**SQUARE, settings=["parts", "angels"]).run(parts_of(), Recorder(), np.random.default_rng(0))
