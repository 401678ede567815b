"""The study of trajectories on plain parts: mapping image by image, bridges, judging, exports."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from omnilab.api import (
    Circle,
    Closures,
    Frames,
    Graph,
    Image,
    Motion,
    NamedPath,
    Parts,
    PathPoses,
    Plan,
    Pose,
    Unusable,
)
from omnilab.cameras import ImageCircle
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import planar_poses, wrap_angle
from omnilab.posegraph.files import read_graph
from omnilab.posegraph.graph import inverse, matrices, vectors
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_study
from omnilab.trajectory.files import read_trajectory
from omnilab_studies import TrajectoryStudy
from omnilab_studies.common.live.pacing import ReplayPace
from omnilab_studies.common.pose_sources import Source
from omnilab_studies.trajectory.front_end import FrontEnd
from omnilab_studies.trajectory.loop_evaluation import evaluate_loops

CAMERA = ImageCircle(16, 16, Circle(7.5, 7.5, 8))
LAP = 24


def lap(count: int = LAP + 2, radius: float = 2.0):
    """Poses on a circle, headed along it; the last two lie over the first two."""
    angle = 2 * np.pi * np.arange(count) / LAP
    return planar_poses(
        np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.ones(count)]), wrap_angle(angle + np.pi / 2)
    )


@dataclass
class Ring:
    """Drives round; an image is its number."""

    count: int = LAP + 2
    black: list[int] = field(default_factory=list)
    stamps: list[int] | None = None
    known: bool = True
    requests: list[Any] = field(default_factory=list)

    def plan(self, layout):
        self.requests.append(layout)
        T = layout.T_world_camera if isinstance(layout, PathPoses) else lap(self.count)
        return Plan([f"{i}.png" for i in range(len(T))], T if self.known else None)

    def frames(self, plan):
        for start in range(0, len(plan), 7):
            part = np.arange(start, min(start + 7, len(plan)))
            images = np.full((len(part), 16, 16), 9, np.uint8)
            images[:, 8, 8] = part + 10
            images[np.isin(part, self.black)] = 0
            stamps = part * 100 if self.stamps is None else np.array(self.stamps)[part]
            T = None if plan.T_world_camera is None else plan.T_world_camera[part]
            yield Frames(images, [plan.keys[i] for i in part], stamps, CAMERA, part, T)

    def scene(self):
        return None


@dataclass
class TrueOdometry:
    """Estimates the circle's true motions, lengths in its own unit, with noise by the seed."""

    factor: float = 1.0
    unit: str = "m"
    noise: float = 0.0
    fails: list[int] = field(default_factory=list)
    turns: bool = False  # it knows them where it fails

    def extract(self, frames):
        return [int(i[8, 8]) - 10 if i.any() else Unusable("black") for i in frames.images]

    def estimate(self, before, now, rng):
        if now in self.fails:
            turn, variance = (true_motion(before, now)[2], 1e-4) if self.turns else (np.nan, np.inf)
            known = np.array([np.nan, np.nan, turn]), np.diag([np.inf, np.inf, variance])
            return Motion(*known, self.unit, "nothing matches")
        vector = true_motion(before, now) * [self.factor, self.factor, 1] + self.noise * rng.standard_normal(3)
        matches = np.array([[[0.1, 0.5], [0.2, 0.5]], [[1.0, 0.5], [0.9, 0.5]]])
        agree = np.array([True, False])
        return Motion(vector, 0.01**2 * np.eye(3), self.unit, "", matches, agree, window_rad=0.0)


def true_motion(before, now):
    T = lap(max(before, now) + 1)
    return vectors((inverse(T[before]) @ T[now])[None], planar=True)[0]


@dataclass
class Everything:
    """Recognises the places of the first lap in the second, and wrong ones where these are given."""

    wrong: dict[int, int] = field(default_factory=dict)

    def begin(self):
        return RevisitDatabase(self)


class RevisitDatabase:
    def __init__(self, settings):
        self.settings, self.count = settings, 0
        self.steps = []

    def query(self, frames, features, step, rng):
        node, self.count = self.count, self.count + 1
        self.steps.append(step)
        nodes = [node - LAP] * (node >= LAP) + [old for new, old in self.settings.wrong.items() if new == node]
        count = len(nodes)
        spread = np.tile(1e-4 * np.eye(3), (count, 1, 1))
        return Closures(np.array(nodes, int), np.zeros((count, 3)), spread, np.zeros(count), count)


class Watching(Recorder):
    """Keeps what is logged."""

    def __init__(self):
        super().__init__()
        self.logged = []

    def log(self, path, record, tick=None):
        self.logged.append((path, record, tick))

    def of(self, path):
        return [(record, tick) for at, record, tick in self.logged if at == path]


@pytest.fixture
def parts(plain):
    """`parts(sensor=..., backend=...)`: plain parts, but for those that are given."""

    def parts(**changed):
        ready = {
            "sensor": Ring(),
            "odometry": TrueOdometry(),
            "loop_closure": Everything(),
            "backend": plain["Least"](),
        }
        return Parts(**{**ready, **changed})

    return parts


@pytest.fixture
def run(parts):
    """`run(study, record, seed=3, backend=...)`: the report of a study of plain parts."""

    def run(study=None, record=None, seed=3, **changed):
        return (study or TrajectoryStudy()).run(parts(**changed), record or Recorder(), np.random.default_rng(seed))

    return run


def values(report):
    return {metric.name: metric.value for metric in report.metrics}


def test_it_keeps_the_contract_of_studies(parts):
    check_study(TrajectoryStudy(jitter=0.1), parts(odometry=TrueOdometry(noise=0.02)))


def test_true_motions_make_the_true_trajectory_whatever_their_unit(run):
    for odometry, scale in ((TrueOdometry(), 1.0), (TrueOdometry(2.5, "1"), 1 / 2.5)):
        found = values(run(odometry=odometry))
        assert found["ate"] == pytest.approx(0, abs=1e-6)
        assert found["odometry_ate"] == pytest.approx(0, abs=1e-6)
        assert found["scale"] == pytest.approx(scale, rel=1e-6)
        assert (found["closures"], found["closure_precision"]) == (2, 1)
        assert found["closure_recall"] == 2 / 4  # the last two of the first lap are as near as two steps to its start
        assert found["step_rotation_error_median"] == pytest.approx(0, abs=1e-6)
        assert found["step_length_spread"] == pytest.approx(0, abs=1e-9)
        assert (found["images"], found["bridged_steps"], found["problems"]) == (LAP + 2, 0, 0)


def test_at_its_own_pace_a_log_gives_the_same_map_and_how_long_each_image_took(run):
    stamps = [20_000_000 * i for i in range(LAP + 2)]
    fast = run(sensor=Ring(stamps=stamps))
    paced = run(TrajectoryStudy(pace=ReplayPace.recorded, waiting=100), sensor=Ring(stamps=stamps))
    assert values(paced) == values(fast)
    assert len(paced.tables["latency"]["latency_ms"]) == LAP + 2
    assert "latency" not in fast.tables


def test_loops_mend_what_odometry_spoils(run):
    found = values(run(odometry=TrueOdometry(noise=0.03)))
    assert found["ate"] < found["odometry_ate"]
    assert found["online_ate"] <= found["odometry_ate"] * 1.01


def test_a_mirrored_trajectory_is_not_aligned(run):
    @dataclass
    class Mirrored(TrueOdometry):
        def estimate(self, before, now, rng):
            motion = super().estimate(before, now, rng)
            return replace(motion, vector=motion.vector * [1, -1, -1])

    assert values(run(odometry=Mirrored(), loop_closure=Everything()))["odometry_ate"] > 1


def test_a_black_image_is_bridged_and_the_next_one_compared_with_the_last_good_one(run):
    record = Watching()
    report = run(record=record, sensor=Ring(black=[5]))
    found, table = values(report), report.tables["steps"]
    assert found["bridged_steps"] == 1
    assert table["bridged"][5] == "black"
    assert any("image 5, 5.png: black" in r.text for r, _ in record.of("log"))
    off = np.hypot(table["final_x_m"] - table["true_x_m"], table["final_y_m"] - table["true_y_m"])
    assert np.delete(off, 5).max() < 0.02  # the black one hangs on a loose bridge, and pulls at the alignment
    assert off[5] < 0.5


@pytest.mark.parametrize("sensor", [Ring(black=[0]), Ring(black=[0, 1]), Ring(black=[LAP + 1]), Ring(black=[4, 5, 6])])
def test_black_images_anywhere_cost_no_map(sensor, run):
    report = run(sensor=sensor)
    bridged = [i for i, why in enumerate(report.tables["steps"]["bridged"]) if why]
    assert set(sensor.black) <= set(bridged)
    assert len(report.tables["steps"]["image"]) == LAP + 2
    assert values(report)["ate"] < 1


def test_a_failed_step_is_bridged_by_the_last_one(run):
    report = run(odometry=TrueOdometry(fails=[7]))
    found, table = values(report), report.tables["steps"]
    assert (found["bridged_steps"], table["bridged"][7]) == (1, "nothing matches")
    assert found["ate"] < 0.25  # it went on ahead: the turn of one step is missing, until the loop is closed
    assert found["odometry_ate"] > found["ate"]


def test_a_step_that_failed_for_its_length_alone_keeps_its_turn(run):
    report, without = (run(odometry=TrueOdometry(fails=[7], turns=turns)) for turns in (True, False))
    assert values(report)["bridged_steps"] == 1
    assert values(report)["odometry_ate"] < values(without)["odometry_ate"] / 3
    turned = np.diff(np.unwrap(np.deg2rad(report.tables["steps"]["odometry_heading_deg"])))
    assert turned[6] == pytest.approx(true_motion(6, 7)[2], abs=1e-6)


def test_another_odometry_bridges_where_the_own_one_fails(run):
    report = run(odometry=TrueOdometry(2.0, "1", fails=[7, 8]), odometries={"wheels": TrueOdometry()})
    found = values(report)
    assert found["bridged_steps"] == 2
    assert found["odometry_ate"] == pytest.approx(0, abs=1e-6)
    assert found["factor_0"] == pytest.approx(0.5, rel=1e-4)


def test_a_gap_in_time_is_bridged(run):
    stamps = [100 * i + (900 if i > 12 else 0) for i in range(LAP + 2)]
    report = run(sensor=Ring(stamps=stamps))
    why = report.tables["steps"]["bridged"]
    assert [i for i, reason in enumerate(why) if reason] == [13]
    assert "10 times the usual time" in why[13]
    assert values(report)["ate"] < 0.05  # the estimate is the guess


def test_images_out_of_time_order_are_refused(run):
    stamps = [100 * i for i in range(LAP + 2)]
    stamps[9] = 750
    with pytest.raises(DataError, match=r"9\.png was taken .* before the one it follows"):
        run(sensor=Ring(stamps=stamps))


@pytest.mark.parametrize("count", [0, 1])
def test_a_sequence_of_one_image_is_refused(count, run):
    with pytest.raises(DataError, match=f"a sequence of {count} image"):
        run(sensor=Ring(count=count))


def test_a_backend_that_takes_no_poses_as_they_come_is_refused(run):
    @dataclass
    class Whole:
        def optimize(self, graph, covariances=False):
            raise AssertionError

    with pytest.raises(ConfigError, match="Whole takes no poses as they come"):
        run(backend=Whole())


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"images": Source.grid}, "makes no trajectory"),
        ({"jitter": 0.5}, "of 0 or more and below 0.5"),
        ({"gap": 1.0}, "gap=1 is out of range; give a number above 1"),
        ({"same_place_m": 0.0}, "same_place_m=0 is out of range"),
        ({"show": 0}, "show=0 is out of range"),
    ],
)
def test_settings_that_mean_nothing_are_refused(wrong, message):
    with pytest.raises(ConfigError, match=message):
        TrajectoryStudy(**wrong)


def test_recorded_images_without_poses_are_mapped_and_not_measured(run):
    report = run(TrajectoryStudy(images=Source.recorded), sensor=Ring(known=False))
    found = values(report)
    assert (found["images"], found["closures"]) == (LAP + 2, 2)
    assert "ate" not in found
    assert "errors" not in report.figures
    assert "truth.tum" not in report.files
    with pytest.raises(ConfigError, match="would move recorded images"):
        run(TrajectoryStudy(images=Source.recorded, jitter=0.1), sensor=Ring())


def test_the_path_comes_from_a_name_or_from_a_file(tmp_path, run):
    sensor = Ring()
    run(TrajectoryStudy(path="route", height_m=0.5), sensor=sensor)
    assert sensor.requests == [NamedPath("route", 0.5)]
    (tmp_path / "path.csv").write_text("x_m,y_m,z_m\n" + "".join(f"{i},0,1\n" for i in range(5)))
    report = run(TrajectoryStudy(path=str(tmp_path / "path.csv")), sensor=Ring())
    assert values(report)["images"] == 5


def test_the_files_read_back_as_the_trajectories_and_the_graph(tmp_path, run):
    report = run(odometry=TrueOdometry(2.0, "1", noise=0.02), odometries={"wheels": TrueOdometry(noise=0.01)})
    for name, text in report.files.items():
        (tmp_path / name).write_text(text)
    table = report.tables["steps"]
    truth = read_trajectory(tmp_path / "truth.tum")
    assert truth.T_world_camera[:, 0, 3] == pytest.approx(table["true_x_m"])
    assert truth.stamps_ns.tolist() == list(table["stamp_ns"])
    graph = read_graph(tmp_path / "graph.g2o")
    final = read_trajectory(tmp_path / "final.tum").T_world_camera
    assert graph.poses[:, :2] == pytest.approx(final[:, :2, 3])
    assert len(graph.edges) == 2 * (LAP + 1) + 2
    # lengths are in one unit: those of the odometry that counts otherwise, too
    steps = graph.edges[:, 1] - graph.edges[:, 0] == 1
    lengths = np.hypot(*graph.motions[steps, :2].T)
    assert lengths == pytest.approx(2 * 2 * np.sin(np.pi / LAP), rel=0.2)
    assert len(report.files["final.kitti"].splitlines()) == LAP + 2


def test_closures_flash_and_the_robot_moves_over_the_truth(run):
    record = Watching()
    report = run(record=record, odometry=TrueOdometry(3.0, "1"))
    flashes = [(tick.step, len(r.edges)) for r, tick in record.of("closures")]
    assert flashes == [(LAP, 1), (LAP + 1, 1)]
    robot = np.array([r.T_world_camera for r, _ in record.of("robot") if isinstance(r, Pose)])
    assert robot[:, :3, 3] == pytest.approx(lap()[:, :3, 3], abs=1e-6)  # scaled by the length of the true path
    (last,) = [r for r, _ in record.of("final/final")]
    assert isinstance(last, Graph)
    assert last.position_m == pytest.approx(lap()[:, :3, 3], abs=1e-5)
    assert all(isinstance(r, Image) for r, _ in record.of("query/panorama"))
    assert report.summary.startswith("## Trajectory")


@pytest.mark.slow
def test_a_backend_of_its_own_may_reject_wrong_closures(run, plain):
    report = run(
        loop_closure=Everything(wrong={12: 2}), backends={"least": plain["Least"](), "again": plain["Least"]()}
    )
    found = values(report)
    assert found["closure_precision"] == pytest.approx(2 / 3)
    assert list(found)[:2] == ["least_ate", "again_ate"]
    assert report.tables["closures"]["right"].tolist() == [0, 1, 1]


# ------------------------------------------------------------------------------------------------------------ its parts
def test_the_place_database_is_given_the_usual_step_in_the_own_unit(plain):
    sensor, database = Ring(), Everything().begin()
    front_end = FrontEnd(
        [TrueOdometry(3.0, "1"), TrueOdometry()], database, plain["Chain"]([np.zeros(3)]), Recorder(), gap=3
    )
    for frames in sensor.frames(sensor.plan(NamedPath(""))):
        for i in range(len(frames)):
            front_end.process(frames.at(i), np.random.default_rng(0))
    step = 2 * 2 * np.sin(np.pi / LAP)
    assert database.steps[-1] == pytest.approx(3 * step)
    assert (front_end.unit, front_end.factors[0]) == ("m", pytest.approx(1 / 3))
    assert set(front_end.groups.tolist()) == {0, -1}
    assert matrices(front_end.poses())[:, :3] == pytest.approx((inverse(lap()[0]) @ lap())[:, :3], abs=1e-9)


def test_closures_are_loops_by_where_images_were_taken():
    truth = lap()
    loops = evaluate_loops(np.array([[0, LAP], [3, 15], [2, 1 + LAP]]), truth, same_place_m=0.6)
    assert loops.right.tolist() == [True, False, True]
    assert loops.revisited.sum() == 2 + 1  # the last of the first lap is near its first, too
    assert loops.precision == pytest.approx(2 / 3)
    assert loops.recall(np.array([[0, LAP], [3, 15], [2, 1 + LAP]])) == pytest.approx(2 / 3)
    nothing = evaluate_loops(np.zeros((0, 2), int), truth, None)
    assert np.isnan(nothing.precision)
    assert nothing.recall(np.zeros((0, 2), int)) == 0
