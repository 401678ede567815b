"""A robot's way and its map from nothing but images, beside the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    Floats,
    Graph,
    Metric,
    Optimized,
    Parts,
    PathPoses,
    PlaceMap,
    Plan,
    Recorder,
    Report,
    Series,
    Text,
)
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import heading_of, planar_poses
from omnilab.posegraph.graph import matrices, vectors
from omnilab.trajectory.evaluation import Alignment, aligned, evaluate, path_length
from omnilab_studies.common.frames import deliver_queries
from omnilab_studies.common.pose_sources import Source, plan_of_trajectory
from omnilab_studies.common.tables import markdown_table
from omnilab_studies.trajectory import figures, scale_estimation
from omnilab_studies.trajectory.layout import LAYOUT
from omnilab_studies.trajectory.loop_evaluation import Judged, judge
from omnilab_studies.trajectory.mapping_run import Way
from omnilab_studies.trajectory.results import (
    closure_table,
    counts_of,
    errors_of,
    files_of,
    loops_of,
    off_m,
    steps_of,
    table_of,
)

ALONE = (209, 64, 63)  # the colour of the way by odometry alone


@dataclass
class Trajectory:
    """Graph-SLAM from appearance (Berenguer, thesis, chapter 6): odometry, loop closures, a map that grows with each image.

    `backend` takes poses as they come; at the end it, and each of the `backends`, optimises the whole graph. Where the
    sensor knows the poses, the trajectories (by odometry alone, as it was online, as optimised) are aligned with them
    and measured. A step that could not be measured is bridged, said and counted.

    The run's folder gets the trajectories in TUM's and KITTI's format and the graph as g2o.
    """

    images: Source = Source.path  # or recorded: all that was recorded, in its order
    path: str = "square"  # of the world, by its name; or a file of poses (.txt, .tum: TUM's format; .csv)
    jitter: float = 0.0  # each pose is moved along the path, by up to this share of a step
    height_m: float | None = None  # of the viewpoint on a path of the world; null: the sensor's own
    alignment: Alignment = Alignment.sim2  # with the truth: none, first, se2, se3, sim2 or sim3
    same_place_m: float | None = None  # poses so close show one place, to judge loop closures; null: two usual steps
    gap: float = 3.0  # a step that took so many times the usual time is bridged
    show: int = 200  # images that go into the logs; the numbers of all of them do

    needs: ClassVar[tuple[str, ...]] = ("sensor", "odometry", "loop_closure", "backend")
    cached: ClassVar[bool] = False  # it measures time

    def __post_init__(self) -> None:
        if self.images not in {Source.path, Source.recorded}:
            raise ConfigError(f"study.images={self.images.value} makes no trajectory; give path or recorded")
        if not 0 <= self.jitter < 0.5:
            raise ConfigError(f"study.jitter={self.jitter} would change the order of the images; give 0 to below 0.5")
        if not self.gap > 1:
            raise ConfigError(f"study.gap={self.gap} makes usual steps gaps; give more than 1")
        if self.same_place_m is not None and not self.same_place_m > 0:
            raise ConfigError(
                f"study.same_place_m={self.same_place_m} holds no two poses; give metres above 0, or null"
            )
        if self.show < 1:
            raise ConfigError(f"study.show={self.show} shows nothing; give 1 or more")

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Map image by image; optimise the whole; measure."""
        plan = self._plan(parts, rng)
        record.log("", LAYOUT)
        if scene := parts.sensor.scene():
            record.log("room", scene)
        if plan.T_world_camera is not None:
            record.log("truth", PlaceMap(plan.T_world_camera[:, :3, 3]))

        # the map as it grows, one image after the other
        way = Way(parts, plan, record, self.show, self.gap)
        seed, mapping = int(rng.integers(2**32)), np.random.default_rng(rng.integers(2**32))
        omitted = list(plan.omitted)
        for frames in deliver_queries(parts, plan, record, seed):
            omitted += frames.omitted
            for i in range(len(frames)):
                way.take(frames.at(i), mapping)
        for sentence in omitted:
            record.log("log", Text(f"left out: {sentence}", "WARN"))
        if len(way.steps) < 2:
            raise DataError(f"a sequence of {len(way.steps)} image makes no trajectory; give 2 or more")

        # the whole of it, optimised
        graph, final = way.mapper.graph(), dict[str, Optimized]()
        for name, backend in record.track(
            (parts.backends or {"final": parts.backend}).items(), "optimize", 1, lambda _: 1
        ):
            with record.timed(f"optimize: {name}"):
                final[name], factors = scale_estimation.optimize(backend, graph, way.mapper.groups, way.mapper.factors)
            for sentence in final[name].warnings:
                record.log("log", Text(f"{name}: {sentence}", "WARN"))
        ways = {"odometry": np.array(way.mapper.alone), "online": np.array(way.mapper.online)}
        ways |= {name: found.poses for name, found in final.items()}

        # what it amounts to
        truth, closures = way.truth, way.closures
        errors = {} if truth is None else {n: evaluate(matrices(p), truth, self.alignment) for n, p in ways.items()}
        judged = None if truth is None else judge(closures, truth, self.same_place_m)
        metrics = [
            *errors_of(errors, list(final)), *loops_of(judged, closures), *steps_of(way), *counts_of(way, final, factors, len(omitted))
        ]  # fmt: skip
        shown = ways if truth is None else {n: self._over(p, truth) for n, p in ways.items()}
        self._tell(record, way, shown, metrics)
        tables = {"steps": table_of(way, shown), "closures": closure_table(closures, judged)}
        return Report(
            metrics, tables, self._figures(way, shown, judged), files=files_of(way, ways, factors, next(iter(final)))
        )

    def _plan(self, parts: Parts, rng: np.random.Generator) -> Plan:
        """The images of the way, in their order."""
        plan = plan_of_trajectory(parts.sensor, self.images, self.path, self.height_m)
        if self.jitter:
            if plan.T_world_camera is None or self.images is Source.recorded:
                raise ConfigError(f"study.jitter={self.jitter} would move recorded images; give 0")
            shift = rng.uniform(-self.jitter, self.jitter, len(plan))
            plan = parts.sensor.plan(PathPoses(jittered(plan.T_world_camera, shift)))
        if len(plan) < 2:
            raise DataError(f"a sequence of {len(plan)} image makes no trajectory; give 2 or more")
        return plan

    def _over(self, poses: Floats, truth: Floats) -> Floats:
        """Poses (n, 3), aligned with the true ones (n, 4, 4)."""
        return vectors(aligned(matrices(poses), truth, self.alignment)[0], planar=True)

    def _tell(self, record: Recorder, way: Way, shown: Mapping[str, Floats], metrics: list[Metric]) -> None:
        """The whole into the logs: the way by odometry alone, as it was optimised, and the errors."""
        last = way.tick(len(way.steps) - 1)
        edges = np.column_stack([np.arange(len(way.steps) - 1), np.arange(1, len(way.steps))])
        height = 0.0 if way.truth is None else float(way.truth[0, 2, 3])
        at = {name: np.column_stack([poses[:, :2], np.full(len(poses), height)]) for name, poses in shown.items()}
        alone = np.tile(np.array(ALONE, np.uint8), (len(edges), 1))
        record.log("odometry", Graph(at.pop("odometry"), edges, alone), last)
        at.pop("online")
        for name, position in at.items():
            record.log(f"final/{name}", Graph(position, way.mapper.graph().edges, way.colors), last)
        for name, off in off_m(way, shown).items():
            steps = np.arange(len(off))
            record.log(f"error/{name}", Series(off, steps, np.array(way.mapper.stamps_ns), "m"))
        record.log("summary", Text(markdown_table(metrics, "Trajectory"), markdown=True))

    def _figures(self, way: Way, shown: Mapping[str, Floats], judged: Judged | None) -> dict[str, Any]:
        truth = way.truth
        panels = {name.replace("_", " "): poses[:, :2] for name, poses in shown.items()}
        drawn: dict[str, Any] = {
            "paths": figures.paths(
                panels, None if truth is None else truth[:, :2, 3], way.closures,
                None if judged is None else judged.right, "m" if truth is not None else way.mapper.unit,
            ),
            "time": figures.times(np.array(way.times_ms)),
        }  # fmt: skip
        if truth is not None:
            drawn["errors"] = figures.errors(path_length(truth), off_m(way, shown))
        return drawn


def jittered(T_world_camera: Floats, shift: Floats) -> Floats:
    """Poses (N, 4, 4), each moved along the way between its neighbours by so many steps (N,), below half a step.

    The first and the last move inwards only.
    """
    count = len(T_world_camera)
    at = np.clip(np.arange(count) + shift, 0, count - 1)
    start = np.minimum(at.astype(int), count - 2)
    share = at - start
    position, heading = T_world_camera[:, :3, 3], np.unwrap(heading_of(T_world_camera))
    between_m = position[start] + share[:, None] * (position[start + 1] - position[start])
    return planar_poses(between_m, heading[start] + share * (heading[start + 1] - heading[start]))
