"""Graph SLAM from images (Berenguer, thesis, chapter 6): a robot's trajectory and map, compared with the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    Floats,
    Graph,
    Optimized,
    Parts,
    PathPoses,
    PlaceMap,
    Plan,
    Recorder,
    Report,
    Series,
    Text,
    check_settings,
    setting,
)
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import heading_of, planar_poses
from omnilab.trajectory.evaluation import Alignment, path_length
from omnilab_studies.common.live.pacing import PacedFrames, ReplayPace, WhenLate
from omnilab_studies.common.logs import start_logs
from omnilab_studies.common.pose_sources import Source, check_is_trajectory, plan_of_trajectory
from omnilab_studies.common.tables import markdown_table
from omnilab_studies.trajectory import figures, scale_estimation
from omnilab_studies.trajectory.layout import LAYOUT
from omnilab_studies.trajectory.mapping_run import MappingRun
from omnilab_studies.trajectory.results import (
    TrajectoryResults,
    closure_table,
    evaluate_run,
    files_of,
    metrics_of,
    position_errors,
    step_table,
)

ODOMETRY = (209, 64, 63)  # the colour of the trajectory by odometry alone


@dataclass
class TrajectoryStudy:
    """Graph SLAM from appearance (Berenguer, thesis, chapter 6): odometry, loop closures, an incremental map.

    `backend` takes poses as they come; at the end it, and each of the `backends`, optimises the whole graph. Where the
    sensor knows the poses, the trajectories (by odometry alone, online, optimised) are aligned with them and measured
    (figures 6.6 and 6.7). A step that could not be measured is bridged, with a warning, and counted.

    The run's folder gets the trajectories in TUM's and KITTI's format and the graph as g2o.
    """

    images: Source = Source.path  # or recorded: all that was recorded, in its order
    path: str = "square"  # of the world, by its name; or a file of poses (.txt, .tum: TUM's format; .csv)
    jitter: float = setting(
        0.0, at_least=0, below=0.5
    )  # each pose is moved along the path, by up to this share of a step
    height_m: float | None = setting(
        None, at_least=-1e6, at_most=1e6
    )  # of the viewpoint on a path of the world; null: the sensor's own
    alignment: Alignment = Alignment.sim2  # with the truth: none, first, se2, se3, sim2 or sim3
    same_place_m: float | None = setting(
        None, above=0
    )  # poses so close show one place, to judge loop closures; null: two usual steps
    gap: float = setting(3.0, above=1)  # a step that took so many times the usual time is bridged
    pace: ReplayPace = ReplayPace.fast  # fast, or recorded: images come at their own times
    when_late: WhenLate = WhenLate.queue  # images that come while others are mapped: queue, or drop all but the newest
    waiting: int = setting(20, at_least=1, at_most=10_000)  # images at most that wait, with when_late=queue
    show: int = setting(200, at_least=1)  # images that go into the logs; the numbers of all of them do

    needs: ClassVar[tuple[str, ...]] = ("sensor", "odometry", "loop_closure", "backend")
    metric_names: ClassVar[tuple[str, ...]] = (
        "ate", "scale", "ate_max", "rpe_metre", "rpe_metre_deg", "drift", "end_drift", "odometry_ate", "odometry_scale",
        "online_ate", "online_scale", "odometry_ate_max", "odometry_rpe_metre", "odometry_rpe_metre_deg",
        "odometry_drift", "odometry_end_drift", "BACKEND_ate", "BACKEND_scale", "BACKEND_ate_max", "BACKEND_rpe_metre",
        "BACKEND_rpe_metre_deg", "BACKEND_drift", "BACKEND_end_drift", "closures", "closure_precision",
        "closure_recall", "seen_again", "same_place", "step_rotation_error_median", "step_rotation_error_mean",
        "step_rotation_error_p95", "step_direction_error_median", "step_direction_error_mean",
        "step_direction_error_p95", "step_length_spread", "images", "left_out", "bridged_steps", "problems",
        "path_length", "BACKEND_rejected", "factor_GROUP",
    )  # fmt: skip
    cached: ClassVar[bool] = False  # it measures time

    def __post_init__(self) -> None:
        check_settings(self, "study.")
        check_is_trajectory(self.images)

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Map image by image, optimise the whole graph, evaluate."""
        plan = self._plan(parts, rng)
        _log_truth(record, parts, plan)
        frames = PacedFrames(self.pace, self.when_late, self.waiting)
        mapping = self._map(frames, parts, plan, record, rng)
        omitted = [*plan.omitted, *frames.omitted]
        optimized, factors = _optimize(parts, mapping, record)
        results = evaluate_run(mapping, optimized, factors, self.alignment, self.same_place_m)
        _log_results(record, results)
        metrics = metrics_of(results, len(omitted))
        return Report(
            metrics,
            tables={"steps": step_table(results), "closures": closure_table(results), **frames.tables()},
            figures=_figures(results),
            files=files_of(results),
            summary=markdown_table(metrics, "Trajectory"),
            omitted=omitted,
        )

    def _plan(self, parts: Parts, rng: np.random.Generator) -> Plan:
        """The images of the trajectory, in their order."""
        plan = plan_of_trajectory(parts.sensor, self.images, self.path, self.height_m)
        if self.jitter:
            if plan.T_world_camera is None or self.images is Source.recorded:
                raise ConfigError(f"study.jitter={self.jitter} would move recorded images; give 0")
            shift = rng.uniform(-self.jitter, self.jitter, len(plan))
            plan = parts.sensor.plan(PathPoses(jittered(plan.T_world_camera, shift)))
        if len(plan) < 2:
            raise DataError(f"a sequence of {len(plan)} image makes no trajectory; give 2 or more")
        return plan

    def _map(
        self, frames: PacedFrames, parts: Parts, plan: Plan, record: Recorder, rng: np.random.Generator
    ) -> MappingRun:
        """The incremental map of all images, one after the other."""
        seed, mapping_rng = int(rng.integers(2**32)), np.random.default_rng(rng.integers(2**32))
        with record.aside() as aside:
            mapping = MappingRun(parts, plan, record, self.show, self.gap, aside)
            for arrived in frames.of(parts, plan, record, seed):
                with frames.answering(arrived, record):
                    mapping.process(arrived.frame, mapping_rng)
        frames.log(record)
        if len(mapping.steps) < 2:
            raise DataError(f"a sequence of {len(mapping.steps)} image makes no trajectory; give 2 or more")
        return mapping


def _optimize(parts: Parts, mapping: MappingRun, record: Recorder) -> tuple[dict[str, Optimized], Floats]:
    """The whole graph, optimised by each of the back ends; the factors (G,) of lengths, of the last of them."""
    front_end = mapping.front_end
    graph, optimized = front_end.graph(), dict[str, Optimized]()
    backends = parts.backends or {"final": parts.backend}
    for name, backend in record.track(backends.items(), "optimize", 1, lambda _: 1):
        with record.timed(f"optimize: {name}"):
            optimized[name], factors = scale_estimation.optimize(backend, graph, front_end.groups, front_end.factors)
        for warning in optimized[name].warnings:
            record.log("log", Text(f"{name}: {warning}", "WARN"))
        for note in optimized[name].notes:
            record.log("log", Text(f"{name}: {note}", "NOTE"))
    return optimized, factors


def _log_truth(record: Recorder, parts: Parts, plan: Plan) -> None:
    """The layout, the world's surface, and the true positions where they are known."""
    start_logs(record, LAYOUT, parts.sensor)
    if plan.T_world_camera is not None:
        record.log("truth", PlaceMap(plan.T_world_camera[:, :3, 3]))


def _log_results(record: Recorder, results: TrajectoryResults) -> None:
    """The trajectory by odometry alone, the optimised maps, and the errors along the trajectory."""
    mapping, truth = results.run, results.run.truth
    last = mapping.tick(len(mapping.steps) - 1)
    edges = np.column_stack([np.arange(len(mapping.steps) - 1), np.arange(1, len(mapping.steps))])
    height = 0.0 if truth is None else float(truth[0, 2, 3])
    at = {name: np.column_stack([p[:, :2], np.full(len(p), height)]) for name, p in results.aligned.items()}
    color = np.tile(np.array(ODOMETRY, np.uint8), (len(edges), 1))
    record.log("odometry", Graph(at["odometry"], edges, color), last)
    for name in results.optimized:
        record.log(f"final/{name}", Graph(at[name], mapping.front_end.graph().edges, mapping.colors), last)
    for name, error in position_errors(results).items():
        record.log(f"error/{name}", Series(error, np.arange(len(error)), np.array(mapping.front_end.stamps_ns), "m"))


def _figures(results: TrajectoryResults) -> dict[str, Any]:
    """Paths with loop closures, time of each image, and errors where the truth is known."""
    mapping, truth, loops = results.run, results.run.truth, results.loops
    panels = {name.replace("_", " "): poses[:, :2] for name, poses in results.aligned.items()}
    drawn: dict[str, Any] = {
        "paths": figures.paths(
            panels, None if truth is None else truth[:, :2, 3], mapping.closures,
            None if loops is None else loops.right, "m" if truth is not None else mapping.front_end.unit,
        ),
        "time": figures.times(np.array(mapping.times_ms)),
    }  # fmt: skip
    if truth is not None:
        drawn["errors"] = figures.errors(path_length(truth), position_errors(results))
    return drawn


def jittered(T_world_camera: Floats, shift: Floats) -> Floats:
    """Poses (N, 4, 4), each moved along the path between its neighbours by so many steps (N,), below half a step.

    The first and the last move inwards only.
    """
    count = len(T_world_camera)
    at = np.clip(np.arange(count) + shift, 0, count - 1)
    start = np.minimum(at.astype(int), count - 2)
    share = at - start
    position, heading = T_world_camera[:, :3, 3], np.unwrap(heading_of(T_world_camera))
    between_m = position[start] + share[:, None] * (position[start + 1] - position[start])
    return planar_poses(between_m, heading[start] + share * (heading[start + 1] - heading[start]))
