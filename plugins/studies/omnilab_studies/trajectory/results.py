"""Results of graph SLAM: errors of the trajectories, metrics, tables, files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Floats, Ints, Metric, Optimized
from omnilab.geometry import wrap_angle
from omnilab.posegraph.files import g2o_text
from omnilab.posegraph.graph import between, matrices, vectors
from omnilab.trajectory.evaluation import Alignment, Evaluation, aligned, evaluate, path_length
from omnilab.trajectory.files import kitti_text, tum_text
from omnilab_studies.common.samples import statistics
from omnilab_studies.trajectory.front_end import MappingStep, scaled
from omnilab_studies.trajectory.loop_evaluation import LoopEvaluation, evaluate_loops
from omnilab_studies.trajectory.mapping_run import MappingRun

REJECTED = 0.5  # weight of a loop closure below which it was rejected


class TrajectoryResults(NamedTuple):
    """Trajectories of n poses by name: odometry alone, online, and one for each back end that optimised the whole graph."""

    run: MappingRun
    optimized: Mapping[str, Optimized]  # by back end
    factors: Floats  # (G,) of the lengths of each odometry
    trajectories: Mapping[str, Floats]  # (n, 3) each, in the map's unit, not aligned
    aligned: Mapping[str, Floats]  # (n, 3) each, aligned with the truth where that is known
    errors: Mapping[str, Evaluation]  # empty where the truth is not known
    loops: LoopEvaluation | None


def evaluate_run(
    run: MappingRun,
    optimized: Mapping[str, Optimized],
    factors: Floats,
    alignment: Alignment,
    same_place_m: float | None,
) -> TrajectoryResults:
    """Every trajectory aligned and measured, loop closures judged, where the truth is known."""
    front_end, truth = run.front_end, run.truth
    poses = {"odometry": np.array(front_end.odometry_poses), "online": np.array(front_end.online_poses)}
    poses |= {name: found.poses for name, found in optimized.items()}
    if truth is None:
        return TrajectoryResults(run, optimized, factors, poses, poses, {}, None)
    errors = {name: evaluate(matrices(p), truth, alignment) for name, p in poses.items()}
    over = {name: vectors(aligned(matrices(p), truth, alignment)[0], planar=True) for name, p in poses.items()}
    loops = evaluate_loops(run.closures, truth, same_place_m)
    return TrajectoryResults(run, optimized, factors, poses, over, errors, loops)


# ------------------------------------------------------------------------------------------------------------- metrics
SHORT, STILL = "the true path is shorter than a metre", "the true path has no length: the robot stood still"


def metrics_of(results: TrajectoryResults, omitted: int) -> list[Metric]:
    """All metrics of a run from which so many images were left out."""
    return [
        *_error_metrics(results.errors, list(results.optimized)),
        *_loop_metrics(results.loops, results.run.closures),
        *_step_metrics(results.run),
        *_count_metrics(results, omitted),
    ]


def _error_metrics(errors: Mapping[str, Evaluation], final: list[str]) -> list[Metric]:
    """ATE and scale of each trajectory, the optimised ones first, and all else of these and of odometry."""
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
            Metric(f"{prefix}rpe_metre", one.rpe_metre_m, "m", note=SHORT),
            Metric(f"{prefix}rpe_metre_deg", float(np.rad2deg(one.rpe_metre_rad)), "deg", note=SHORT),
            Metric(f"{prefix}drift", one.drift, "1", note=STILL),
            Metric(f"{prefix}end_drift", one.end_drift, "1", note=STILL),
        ]
    return [*ate, *scale, *rest]


def _loop_metrics(loops: LoopEvaluation | None, closures: Ints) -> list[Metric]:
    """How many loop closures (L, 2) there are; precision and recall where the truth is known."""
    count = Metric("closures", len(closures), "1")
    if loops is None:
        return [count]
    return [
        count,
        Metric("closure_precision", loops.precision, "1", note=STILL if len(closures) else "no loop was closed"),
        Metric("closure_recall", loops.recall(closures), "1", note="no image shows a place that was shown before"),
        Metric("seen_again", int(loops.revisited.sum()), "1"),
        Metric("same_place", loops.same_place_m, "m"),
    ]


def _step_metrics(run: MappingRun) -> list[Metric]:
    """Errors of the run's odometry in the steps that it estimated: rotation, direction, and spread of the length."""
    if run.truth is None:
        return []
    estimated = [
        (step.before, node, step.motion.vector)
        for node, step in enumerate(run.steps)
        if step.motion is not None and not step.motion.failed
    ]
    if not estimated:
        return []
    ends = np.array([(before, node) for before, node, _ in estimated])
    motion, true = np.array([vector for *_, vector in estimated]), between(vectors(run.truth, planar=True), ends)
    length, true_length = (np.hypot(m[:, 0], m[:, 1]) for m in (motion, true))
    moving = (length > 0) & (true_length > 0)
    rotation = np.abs(wrap_angle(motion[:, 2] - true[:, 2]))
    direction = [np.arctan2(m[:, 1], m[:, 0]) for m in (motion, true)]
    direction_error = np.abs(wrap_angle(direction[0] - direction[1]))[moving]
    ratio = length[moving] / true_length[moving]
    spread = float(np.std(ratio) / np.mean(ratio)) if len(ratio) else float("nan")
    return [
        *statistics("step_rotation_error", np.rad2deg(rotation), "deg"),
        *(statistics("step_direction_error", np.rad2deg(direction_error), "deg") if moving.any() else []),
        Metric("step_length_spread", spread, "1", note="no step was both estimated and made"),
    ]


def _count_metrics(results: TrajectoryResults, omitted: int) -> list[Metric]:
    """Images, bridges, warnings, path length, rejected loop closures, and factors where lengths had any."""
    run, final = results.run, results.optimized
    rejected = {
        f"{name}_rejected": int((found.weights[run.front_end.loops] < REJECTED).sum()) for name, found in final.items()
    }
    length = [] if run.truth is None else [Metric("path_length", float(path_length(run.truth)[-1]), "m")]
    free = run.front_end.groups.max(initial=-1) >= 0
    warnings = sum(len(step.warnings) for step in run.steps) + sum(len(found.warnings) for found in final.values())
    return [
        Metric("images", len(run.steps), "1"),
        Metric("left_out", omitted, "1"),
        Metric("bridged_steps", sum(step.bridged != "" for step in run.steps), "1"),
        Metric("problems", warnings, "1"),
        *length,
        *(Metric(name, count, "1") for name, count in rejected.items()),
        *(Metric(f"factor_{k}", float(factor), "1") for k, factor in enumerate(results.factors) if free),
    ]


# ----------------------------------------------------------------------------------------------------- tables and files
def position_errors(results: TrajectoryResults) -> dict[str, Floats]:
    """Distances (n,) in metres of each trajectory's aligned positions from the true ones; none without the truth."""
    truth = results.run.truth
    if truth is None:
        return {}
    return {name: np.linalg.norm(poses[:, :2] - truth[:, :2, 3], axis=1) for name, poses in results.aligned.items()}


def step_table(results: TrajectoryResults) -> dict[str, Any]:
    """A row an image: bridges, inliers, loop closures; every trajectory, aligned with the truth where that is known."""
    run = results.run
    table: dict[str, Any] = {
        "image": np.arange(len(run.steps)),
        "key": run.keys,
        "stamp_ns": run.front_end.stamps_ns,
        "bridged": [step.bridged for step in run.steps],
        "matches": [_inlier_count(step) for step in run.steps],
        "closures": [len(step.closures.nodes) for step in run.steps],
        "time_ms": np.round(run.times_ms, 3),
    }
    known = results.aligned if run.truth is None else {"true": vectors(run.truth, planar=True), **results.aligned}
    for name, poses in known.items():
        table |= {
            f"{name}_x_m": poses[:, 0],
            f"{name}_y_m": poses[:, 1],
            f"{name}_heading_deg": np.rad2deg(poses[:, 2]),
        }
    return table


def _inlier_count(step: MappingStep) -> int:
    """How many matches are inliers of the step's motion."""
    return 0 if step.motion is None or step.motion.agree is None else int(step.motion.agree.sum())


def closure_table(results: TrajectoryResults) -> dict[str, Any]:
    """A row a loop closure: its nodes, and whether it is right, where the truth is known."""
    closures, loops = results.run.closures, results.loops
    table: dict[str, Any] = {"earlier": closures[:, 0], "later": closures[:, 1]}
    return table if loops is None else table | {"right": loops.right.astype(int)}


def files_of(results: TrajectoryResults) -> dict[str, str]:
    """Trajectories in TUM's and KITTI's format, in the map's unit and not aligned; the graph as g2o.

    The graph has the poses of the first back end.
    """
    run, graph = results.run, results.run.front_end.graph()
    motions, information = scaled(graph.motions, graph.information, run.front_end.groups, results.factors)
    poses = results.trajectories[next(iter(results.optimized))]
    graph = replace(graph, poses=poses, motions=motions, information=information)
    stamps_ns = np.array(run.front_end.stamps_ns)
    known = {name: matrices(p) for name, p in results.trajectories.items()}
    if run.truth is not None:
        known["truth"] = run.truth
    files = {f"{name}.tum": tum_text(T, stamps_ns) for name, T in known.items()}
    files |= {f"{name}.kitti": kitti_text(T) for name, T in known.items()}
    return files | {"graph.g2o": g2o_text(graph)}
