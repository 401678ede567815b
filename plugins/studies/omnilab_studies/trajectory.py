"""A robot's way and its map from nothing but images, beside the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    Floats,
    Graph,
    Ints,
    Metric,
    NamedPath,
    Optimized,
    Parts,
    PathPoses,
    PlaceMap,
    Plan,
    PoseGraph,
    RecordedPoses,
    Recorder,
    Report,
    Series,
    Text,
)
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import heading_of, planar_poses, wrap_angle
from omnilab.graph_files import g2o_text
from omnilab.graphs import between, matrices, vectors
from omnilab.trajectories import Alignment, Evaluation, aligned, evaluate, kitti_text, path_length, tum_text
from omnilab.trajectory_files import read_trajectory
from omnilab_studies import scales
from omnilab_studies import trajectory_figures as figures
from omnilab_studies.common import deliver_queries, markdown_table, statistics
from omnilab_studies.layouts import TRAJECTORY
from omnilab_studies.loops import Judged, judge
from omnilab_studies.mapper import Step, scaled
from omnilab_studies.sources import Source
from omnilab_studies.way import Way

ALONE = (209, 64, 63)  # the colour of the way by odometry alone
REJECTED = 0.5  # a loop closure that counts less than this is


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
        record.log("", TRAJECTORY)
        if scene := parts.sensor.scene():
            record.log("room", scene)
        if plan.T_world_camera is not None:
            record.log("truth", PlaceMap(plan.T_world_camera[:, :3, 3]))

        # the map as it grows, one image after the other
        way = Way(parts, plan, record, self.show, self.gap)
        seed, mapping = int(rng.integers(2**32)), np.random.default_rng(rng.integers(2**32))
        for frames in deliver_queries(parts, plan, record, seed):
            for i in range(len(frames)):
                way.take(frames.at(i), mapping)
        if len(way.steps) < 2:
            raise DataError(f"a sequence of {len(way.steps)} image makes no trajectory; give 2 or more")

        # the whole of it, optimised
        graph, final = way.mapper.graph(), dict[str, Optimized]()
        for name, backend in record.track(
            (parts.backends or {"final": parts.backend}).items(), "optimize", 1, lambda _: 1
        ):
            with record.timed(f"optimize: {name}"):
                final[name], factors = scales.optimize(backend, graph, way.mapper.groups, way.mapper.factors)
            for sentence in final[name].said:
                record.log("log", Text(f"{name}: {sentence}", "WARN"))
        ways = {"odometry": np.array(way.mapper.alone), "online": np.array(way.mapper.online)}
        ways |= {name: found.poses for name, found in final.items()}

        # what it amounts to
        truth, closures = way.truth, way.closures
        errors = {} if truth is None else {n: evaluate(matrices(p), truth, self.alignment) for n, p in ways.items()}
        judged = None if truth is None else judge(closures, truth, self.same_place_m)
        metrics = [
            *_errors(errors, list(final)), *_loops(judged, closures), *_steps(way), *_counts(way, graph, final, factors)
        ]  # fmt: skip
        shown = ways if truth is None else {n: self._over(p, truth) for n, p in ways.items()}
        self._tell(record, way, shown, metrics)
        tables = {"steps": _table(way, shown), "closures": _closures(closures, judged)}
        return Report(
            metrics, tables, self._figures(way, shown, judged), files=_files(way, ways, factors, next(iter(final)))
        )

    def _plan(self, parts: Parts, rng: np.random.Generator) -> Plan:
        """The images of the way, in their order."""
        shift = rng.uniform(-self.jitter, self.jitter, 1 << 20) if self.jitter else None
        if self.images is Source.recorded:
            plan = parts.sensor.plan(RecordedPoses())
        elif Path(self.path).suffix:
            plan = parts.sensor.plan(PathPoses(read_trajectory(Path(self.path)).T_world_camera))
        else:
            plan = parts.sensor.plan(NamedPath(self.path, self.height_m))
        if shift is not None:
            if plan.T_world_camera is None or self.images is Source.recorded:
                raise ConfigError(f"study.jitter={self.jitter} would move recorded images; give 0")
            plan = parts.sensor.plan(PathPoses(jittered(plan.T_world_camera, shift[: len(plan)])))
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
        for name, off in _off(way, shown).items():
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
            drawn["errors"] = figures.errors(path_length(truth), _off(way, shown))
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


# ------------------------------------------------------------------------------------------------------------- metrics
def _errors(errors: Mapping[str, Evaluation], final: list[str]) -> list[Metric]:
    """ATE and scale of each trajectory, the optimised ones first, and all else of the first of these."""
    if not errors:
        return []
    names = {name: "" if len(final) == 1 else f"{name}_" for name in final}
    names |= {"odometry": "odometry_", "online": "online_"}
    ate = [Metric(f"{names[name]}ate", errors[name].ate_m, "m") for name in (*final, "odometry", "online")]
    scale = [Metric(f"{names[name]}scale", errors[name].scale, "1") for name in (*final, "odometry", "online")]
    rest = []
    for name in (*final, "odometry"):
        one, prefix = errors[name], names[name]
        rest += [
            Metric(f"{prefix}ate_max", one.ate_max_m, "m"),
            Metric(f"{prefix}rpe_metre", one.rpe_metre_m, "m"),
            Metric(f"{prefix}rpe_metre_deg", float(np.rad2deg(one.rpe_metre_rad)), "deg"),
            Metric(f"{prefix}drift", one.drift, "1"),
            Metric(f"{prefix}end_drift", one.end_drift, "1"),
        ]
    return [*ate, *scale, *rest]


def _loops(judged: Judged | None, closures: Ints) -> list[Metric]:
    found = [Metric("closures", len(closures), "1")]
    if judged is None:
        return found
    return [
        *found,
        Metric("closure_precision", judged.precision, "1"),
        Metric("closure_recall", judged.recall(closures), "1"),
        Metric("seen_again", int(judged.again.sum()), "1"),
        Metric("same_place", judged.same_place_m, "m"),
    ]


def _steps(way: Way) -> list[Metric]:
    """How well the odometry told the steps that it told."""
    if way.truth is None:
        return []
    told = [
        (step.before, node, step.motion.vector)
        for node, step in enumerate(way.steps)
        if step.motion is not None and not step.motion.failed
    ]
    if not told:
        return []
    ends = np.array([(before, node) for before, node, _ in told])
    motion, true = np.array([vector for *_, vector in told]), between(vectors(way.truth, planar=True), ends)
    length, true_length = (np.hypot(m[:, 0], m[:, 1]) for m in (motion, true))
    moving = (length > 0) & (true_length > 0)
    turn = np.abs(wrap_angle(motion[:, 2] - true[:, 2]))
    way_off = np.abs(wrap_angle(np.arctan2(motion[:, 1], motion[:, 0]) - np.arctan2(true[:, 1], true[:, 0])))[moving]
    ratio = length[moving] / true_length[moving]
    spread = float(np.std(ratio) / np.mean(ratio)) if len(ratio) else float("nan")
    return [
        *statistics("step_rotation_error", np.rad2deg(turn), "deg"),
        *(statistics("step_direction_error", np.rad2deg(way_off), "deg") if moving.any() else []),
        Metric("step_length_spread", spread, "1"),
    ]


def _counts(way: Way, graph: PoseGraph, final: Mapping[str, Optimized], factors: Floats) -> list[Metric]:
    rejected = {
        f"{name}_rejected": int((found.weights[way.mapper.loops] < REJECTED).sum()) for name, found in final.items()
    }
    length = [] if way.truth is None else [Metric("path_length", float(path_length(way.truth)[-1]), "m")]
    free = way.mapper.groups.max(initial=-1) >= 0
    return [
        Metric("images", len(graph), "1"),
        Metric("bridged_steps", sum(step.trouble != "" for step in way.steps), "1"),
        Metric("problems", sum(len(step.said) for step in way.steps) + sum(len(f.said) for f in final.values()), "1"),
        *length,
        *(Metric(name, count, "1") for name, count in rejected.items()),
        *(Metric(f"factor_{k}", float(factor), "1") for k, factor in enumerate(factors) if free),
    ]


# -------------------------------------------------------------------------------------------------------------- results
def _off(way: Way, shown: Mapping[str, Floats]) -> dict[str, Floats]:
    """Metres (n,) that each trajectory's aligned positions are off."""
    if way.truth is None:
        return {}
    return {name: np.linalg.norm(poses[:, :2] - way.truth[:, :2, 3], axis=1) for name, poses in shown.items()}


def _table(way: Way, shown: Mapping[str, Floats]) -> dict[str, Any]:
    """A row an image: every trajectory, aligned with the truth where that is known; what was told and recognised."""
    table: dict[str, Any] = {
        "image": np.arange(len(way.steps)),
        "key": way.keys,
        "stamp_ns": way.mapper.stamps_ns,
        "bridged": [step.trouble for step in way.steps],
        "matches": [_agreeing(step) for step in way.steps],
        "closures": [len(step.closures.nodes) for step in way.steps],
        "time_ms": np.round(way.times_ms, 3),
    }
    known = shown if way.truth is None else {"true": vectors(way.truth, planar=True), **shown}
    for name, poses in known.items():
        table |= {
            f"{name}_x_m": poses[:, 0],
            f"{name}_y_m": poses[:, 1],
            f"{name}_heading_deg": np.rad2deg(poses[:, 2]),
        }
    return table


def _agreeing(step: Step) -> int:
    """How many matches agree with the motion that was told."""
    return 0 if step.motion is None or step.motion.agree is None else int(step.motion.agree.sum())


def _closures(closures: Ints, judged: Judged | None) -> dict[str, Any]:
    table: dict[str, Any] = {"earlier": closures[:, 0], "later": closures[:, 1]}
    return table if judged is None else table | {"right": judged.right.astype(int)}


def _files(way: Way, ways: Mapping[str, Floats], factors: Floats, last: str) -> dict[str, str]:
    """Trajectories in TUM's and KITTI's format, in the map's unit and not aligned; and the graph."""
    graph = way.mapper.graph()
    motions, information = scaled(graph.motions, graph.information, way.mapper.groups, factors)
    graph = replace(graph, poses=ways[last], motions=motions, information=information)
    stamps_ns = np.array(way.mapper.stamps_ns)
    known = {name: matrices(poses) for name, poses in ways.items()}
    if way.truth is not None:
        known["truth"] = way.truth
    files = {f"{name}.tum": tum_text(T, stamps_ns) for name, T in known.items()}
    files |= {f"{name}.kitti": kitti_text(T) for name, T in known.items()}
    return files | {"graph.g2o": g2o_text(graph)}
