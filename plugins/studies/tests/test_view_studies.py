"""Drives without images, consistency, and the studies of view filters on a plain one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.stats import chi2

from omnilab.api import Parts, Text
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import wrap_angle
from omnilab.posegraph.graph import moved
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_study
from omnilab_studies import ViewCount, ViewRange
from omnilab_studies.view_slam.consistency import chi2_quantile, ellipses, errors, nees, nees_bounds
from omnilab_studies.view_slam.drives import Drives, line_of_sight
from omnilab_studies.view_slam.filter_comparison import FilterRun, drives_of, row_of
from omnilab_studies.view_slam.filter_runs import position_rms, run_filter, trace_nees
from omnilab_studies.view_slam.scenarios import lap, scenario, shipped
from omnilab_studies.view_slam.view_count.study import with_exponents

GOOD = """
path_m: [[0, 0], [8, 0], [8, 6], [0, 6]]
walls_m: [[4, -1, 4, 7]]
step_m: 0.5
odometry: {along_m: 0.05, across_m: 0.02, heading_deg: 1, turn_deg: 2}
"""


@dataclass
class DeadReckoning:
    """Believes odometry alone; warns once, and gates the views of even number."""

    def begin(self, pose, covariance):
        return Believer(pose, covariance)


class Believer:
    def __init__(self, pose, covariance):
        self.trajectory, self.taken, self.P = [pose], [], covariance

    def predict(self, motion, covariance):
        self.trajectory.append(moved(self.trajectory[-1], motion))
        self.P = self.P + np.eye(3) * 1e-3
        return ["off we go"] if len(self.trajectory) == 2 else []

    def observe(self, views, angles_rad, covariances):
        assert angles_rad.shape == (len(views), 2)
        assert covariances.shape == (len(views), 2, 2)
        assert max(views) < len(self.taken)
        return views % 2 == 1, []

    def add_view(self):
        self.taken.append(self.trajectory[-1])
        return len(self.taken) - 1

    def pose(self):
        return self.trajectory[-1], self.P

    def views(self):
        return np.array(self.taken).reshape(-1, 3)

    def view_covariances(self):
        return np.tile(self.P, (len(self.taken), 1, 1))

    def finish(self):
        return np.array(self.trajectory)


class Log(Recorder):
    def __init__(self):
        super().__init__()
        self.records = []

    def log(self, path, record, tick=None):
        self.records.append((path, record, tick))


@pytest.fixture
def small(tmp_path):
    file = tmp_path / "small.yaml"
    file.write_text(GOOD)
    return str(file)


# --------------------------------------------------------------------------------------------------------- line of sight
@pytest.mark.parametrize(
    ("one", "other", "clear"),
    [
        ((0, 0), (2, 0), False),  # across
        ((0, 0), (0.9, 0), True),  # short of it
        ((0, 2), (2, 2), True),  # past its end
        ((0, 1), (2, 1), False),  # through its end
        ((1, 2), (1, 3), True),  # on its line, beyond it
        ((1, -2), (1, 2), False),  # along it
        ((1, 0.5), (3, 3), False),  # from on it
        ((0, -3), (3, 0.1), True),  # around its other end
    ],
)
def test_line_of_sight_past_one_wall(one, other, clear):
    wall = np.array([[[1.0, -1], [1, 1]]])
    for a, b in ((one, other), (other, one)):
        assert line_of_sight(np.array([a], float), np.array([b], float), wall)[0, 0] == clear
        assert line_of_sight(np.array([a], float), np.array([b], float), wall[:, ::-1])[0, 0] == clear


def test_without_walls_all_is_seen_and_any_wall_blocks():
    rng = np.random.default_rng(0)
    points, others = rng.uniform(-1, 1, (5, 2)), rng.uniform(-1, 1, (4, 2))
    assert line_of_sight(points, others, np.zeros((0, 2, 2))).all()
    walls = rng.uniform(-1, 1, (3, 2, 2))
    each = [line_of_sight(points, others, wall[None]) for wall in walls]
    assert np.array_equal(line_of_sight(points, others, walls), np.all(each, axis=0))


# ---------------------------------------------------------------------------------------------------------------- drives
def test_a_lap_goes_round_in_equal_steps():
    found = lap(np.array([[0.0, 0], [8, 0], [8, 6], [0, 6]]), 0.25)
    steps = np.linalg.norm(np.roll(found, -1, axis=0)[:, :2] - found[:, :2], axis=1)
    assert np.allclose(steps, 0.25, atol=0.02)  # chords of rounded corners
    turns = wrap_angle(np.diff(found[:, 2], append=found[:1, 2]))
    assert turns.sum() == pytest.approx(2 * np.pi)
    assert found[:, 0].min() >= 0
    assert found[:, 1].max() <= 6


def test_a_drive_is_two_laps_and_its_noise_is_what_it_says(small):
    ground = scenario(small)
    done = [Drives().drive(ground, 6, np.random.default_rng(seed)) for seed in range(200)]
    first = done[0]
    assert np.allclose(first.truth[0], first.truth[-1])
    assert len(first.truth) == 2 * len(ground.lap) + 1
    assert first.view_steps[0] == 0
    assert (np.diff(first.view_steps) > 0).all()
    assert first.view_steps[-1] < len(ground.lap)
    off = np.array([one.motions[3] for one in done])
    expected = np.sqrt(np.diagonal(first.covariances[3]))
    assert np.allclose(off.std(axis=0), expected, rtol=0.25)
    step, view = 40, 0
    bearing, heading = first.truth[view, :2] - first.truth[step, :2], first.truth[step, 2]
    true = np.array([np.arctan2(bearing[1], bearing[0]) - heading, first.truth[view, 2] - heading])
    seen = wrap_angle(np.array([one.angles_rad[step, view] for one in done]) - true)
    assert np.allclose(seen.mean(axis=0), 0, atol=4 * 0.1 / np.sqrt(200))
    assert np.allclose(seen.std(axis=0), 0.1, rtol=0.2)


def test_candidates_are_taken_in_range_in_sight_and_not_too_near(small):
    ground = scenario(small)
    done = Drives(nearest_m=1.5).drive(ground, 8, np.random.default_rng(1))
    seen = 0
    for step in range(len(done.truth)):
        for view in range(8):
            at = done.truth[done.view_steps[view], :2]
            far = np.hypot(*(done.truth[step, :2] - at))
            same_side = (done.truth[step, 0] - 4) * (at[0] - 4) > 0  # of the wall at x = 4
            expected = step > done.view_steps[view] and 1.5 <= far < 5 and same_side
            assert (view in done.candidates(step, 5.0)) == expected
            seen += expected
    assert seen > 50


def test_mishaps_are_as_frequent_as_they_should_be(small):
    ground = scenario(small)
    done = Drives(wrong_share=0.3, gap_share=0.2, halt_share=0.25, laps=20).drive(ground, 8, np.random.default_rng(2))
    assert done.wrong.mean() == pytest.approx(0.3, abs=0.02)
    poses = 20 * len(ground.lap) + 1
    assert len(done.truth) / poses == pytest.approx(1.25, abs=0.06)
    missed = (done.motions == 0).all(axis=1) & (done.covariances[:, 0, 0] > 0.1)
    assert missed.mean() == pytest.approx(0.2, abs=0.04)
    halts = np.isclose(done.covariances[:, 0, 0], 0)
    assert np.allclose(done.truth[1:][halts], done.truth[:-1][halts])
    with pytest.raises(ConfigError, match="do not fit"):
        Drives().drive(ground, 500, np.random.default_rng(0))


# ------------------------------------------------------------------------------------------------------------- scenarios
def test_shipped_scenarios_are_sound_and_no_wall_is_on_the_path():
    assert set(shipped()) == {"open", "walls"}
    for name in shipped():
        ground = scenario(name)
        ahead = np.roll(ground.lap, -1, axis=0)
        for a, b in zip(ground.lap, ahead, strict=True):
            assert line_of_sight(a[None, :2], b[None, :2], ground.walls_m).all()
    assert len(scenario("walls").walls_m) > len(scenario("open").walls_m) == 0


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("step_m: 0.5", "step_m: -1", "step_m is -1"),
        ("step_m: 0.5", "step_m: 1.0e-9", "change step_m"),
        ("step_m", "stepm", r"did you mean step_m\?"),
        ("step_m: 0.5", "", "lacks 'step_m'"),
        ("[0, 6]]", "[0, 6, 1]]", "path_m is"),
        ("[[4, -1, 4, 7]]", "none", "walls_m is"),
        ("[[4, -1, 4, 7]]", "[[4, -1, 4, .nan]]", "walls_m is"),
        ("turn_deg: 2", "turn_deg: many", "odometry.turn_deg"),
        ("[8, 0], [8, 6], ", "", "corners"),
        ("path_m: [", "path_m: ]", "no YAML"),
        ("path_m: [", "step_m: &a 1\npath_m: [*a, ", r"line 3: '\*a' is an alias; write the value out"),
        ("walls_m: [[4, -1, 4, 7]]", "walls_m: !!python/object/apply:os.getcwd []", "no YAML"),
    ],
)
def test_a_scenario_with_a_mistake_is_one_sentence(tmp_path, old, new, word):
    file = tmp_path / "mine.yaml"
    assert old in GOOD
    file.write_text(GOOD.replace(old, new))
    with pytest.raises(DataError, match=word):
        scenario(str(file))


def test_a_scenario_that_is_not_there_or_too_large(tmp_path):
    with pytest.raises(DataError, match=r"did you mean walls\?"):
        scenario("wals")
    (tmp_path / "large.yaml").write_text("#" * 200_000)
    with pytest.raises(DataError, match="200000 bytes"):
        scenario(str(tmp_path / "large.yaml"))


# ----------------------------------------------------------------------------------------------------------- consistency
@pytest.mark.parametrize("dof", [1, 2, 3, 24, 150, 3000])
@pytest.mark.parametrize("probability", [0.025, 0.5, 0.975])
def test_quantiles_are_those_of_scipy(dof, probability):
    assert chi2_quantile(probability, dof) == pytest.approx(chi2.ppf(probability, dof), rel=1e-9)


def test_nees_of_sound_errors_is_within_its_bounds():
    rng = np.random.default_rng(0)
    root = rng.standard_normal((3, 3))
    error = rng.standard_normal((2000, 20, 3)) @ root.T
    found = nees(error, np.broadcast_to(root @ root.T, (2000, 20, 3, 3))).mean(axis=1)
    low, high = nees_bounds(20)
    assert ((low < found) & (found < high)).mean() == pytest.approx(0.95, abs=0.02)
    assert errors(np.array([0, 0, 3.1]), np.array([0, 0, -3.1]))[2] == pytest.approx(6.2 - 2 * np.pi)


def test_an_ellipse_is_as_far_out_as_it_says():
    P = np.array([[[2.0, 0.7], [0.7, 1.0]]])
    outline = ellipses(np.array([[1.0, -1]]), P, sigmas=3)[0] - [1, -1]
    assert np.allclose(np.einsum("ni,ij,nj->n", outline, np.linalg.inv(P[0]), outline), 9)


# --------------------------------------------------------------------------------------------------------------- studies
def test_dead_reckoning_is_odometry(small):
    done = Drives(wrong_share=0.2).drive(scenario(small), 6, np.random.default_rng(0))
    trace = run_filter(DeadReckoning(), done, 4.0)
    assert np.allclose(trace.poses, done.odometry)
    assert position_rms(trace.final_poses, done.truth) == pytest.approx(position_rms(done.odometry, done.truth))
    seen = [(step, view) for step in range(len(done.truth)) for view in done.candidates(step, 4.0)]
    assert trace.observed == len(seen)
    assert trace.wrong == sum(done.wrong[at] for at in seen)
    assert trace.wrong_gated == sum(done.wrong[at] and at[1] % 2 == 0 for at in seen)
    assert trace.gated == sum(not done.wrong[at] and at[1] % 2 == 0 for at in seen)
    assert trace.warnings == ["off we go"]
    assert trace_nees(trace, done).shape == (len(done.truth) - 1,)


def test_view_range_keeps_the_contract_and_measures_odometry(small):
    study = ViewRange(ranges_m=[2.0, 4.0], scenarios=[small], views=4, seeds=3, fewer_seeds={"two": 2})
    parts = Parts(view_filters={"one": DeadReckoning(), "two": DeadReckoning()})
    check_study(study, parts)
    log = Log()
    report = study.run(parts, log, np.random.default_rng(1))
    found = {metric.name: metric.value for metric in report.metrics}
    assert found["one_small_rms"] == pytest.approx(found["odometry_small_rms"])
    assert found["one_small_rms_common"] == pytest.approx(found["two_small_rms"])
    assert "one_small_converged_from" not in found  # it never does
    assert report.tables["ranges"]["seeds"] == [3, 2, 3, 2]
    assert report.tables["ranges"]["worse_m"] == [0, 0, 0, 0]
    assert report.tables["drives"]["drive"] == [0, 1, 2, 0, 1] * 2
    assert found["one_small_rms"] == pytest.approx(np.mean(report.tables["drives"]["rms_m"][5:8]))
    assert found["said"] == 2 * 3 + 2 * 2
    assert set(report.figures) == {"scenarios", "ranges", "nees", "drive"}
    paths = {path for path, _, _ in log.records}
    assert {"truth", "odometry", "walls", "trajectory", "views", "candidates", "bearings", "robot"} <= paths
    assert report.summary.startswith("## Error against the range")
    assert any(isinstance(r, Text) and "one, small, 2 m: off we go" in r.text for _, r, _ in log.records)


def test_filters_are_compared_on_the_same_drives():
    """Drives differ far more than filters do: pairs show what means of different drives would hide."""
    rng = np.random.default_rng(0)
    first = [1.0, 5.0, 2.0, 9.0, 4.0, 7.0]
    better = [rms - 0.2 + 0.01 * rng.standard_normal() for rms in first[:5]]
    row = row_of([ran_with(rms) for rms in better], [ran_with(rms) for rms in first], 5, rng)
    assert row["worse_m"] == pytest.approx(-0.2, abs=0.02)
    assert row["worse_low_m"] < row["worse_m"] < row["worse_high_m"] < -0.15
    assert drives_of([ran_with(rms) for rms in better])[3]["rms_m"] == better[3]


def ran_with(rms_m):
    return FilterRun(rms_m, rms_m, 9.0, np.full(10, 3.0), 10, 0, 0, 0, 0, 1.0)


def test_a_filter_has_converged_where_it_stays_good():
    def rows(*shares):
        return [{"range_m": float(i), "rms_m": share, "odometry_rms_m": 1.0} for i, share in enumerate(shares)]

    study = ViewRange()
    assert study.converged_from(rows(0.9, 0.2, 0.3, 0.2, 0.1)) == 3
    assert study.converged_from(rows(0.1, 0.1)) == 0
    assert np.isnan(study.converged_from(rows(0.1, 0.9)))


def test_view_count_keeps_the_contract_and_no_time_is_a_metric(small):
    study = ViewCount(counts=[2, 4, 6], scenario=small, range_m=4.0, seeds=2)
    parts = Parts(view_filter=DeadReckoning())
    check_study(study, parts)
    report = study.run(parts, Log(), np.random.default_rng(1))
    assert not [metric for metric in report.metrics if "ms" in metric.name.split("_") or metric.unit == "ms"]
    assert report.tables["times"]["views"] == [2, 4, 6]
    assert set(report.figures) == {"counts", "nees", "drive"}


def test_exponents_are_slopes():
    times = [{"views": n, "filter": "a", "step_ms": 3.0 * n**2} for n in (2, 4, 8, 16)]
    assert with_exponents(times, ["a"])[0]["exponent"] == pytest.approx(2)


@pytest.mark.parametrize(
    ("kind", "settings"),
    [
        (ViewRange, {"seeds": 1}),
        (ViewRange, {"ranges_m": [3.0, 1.0]}),
        (ViewRange, {"views": 0}),
        (ViewRange, {"fewer_seeds": {"a": 0}}),
        (ViewCount, {"counts": [4]}),
        (ViewCount, {"range_m": 0.0}),
        (Drives, {"laps": 0}),
        (Drives, {"sigma_rad": 0.0}),
        (Drives, {"wrong_share": 1.0}),
    ],
)
def test_settings_that_cannot_be_are_one_sentence(kind, settings):
    with pytest.raises(ConfigError, match=r"study\."):
        kind(**settings)


def test_without_filters_there_is_nothing_to_study():
    with pytest.raises(ConfigError, match="needs view filters"):
        ViewRange().run(Parts(), Log(), np.random.default_rng(0))
