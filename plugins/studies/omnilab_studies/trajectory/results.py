"""What a trajectory amounts to: metrics, tables, files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from omnilab.api import Floats, Ints, Metric, Optimized
from omnilab.geometry import wrap_angle
from omnilab.posegraph.files import g2o_text
from omnilab.posegraph.graph import between, matrices, vectors
from omnilab.trajectory.evaluation import Evaluation, path_length
from omnilab.trajectory.files import kitti_text, tum_text
from omnilab_studies.common.samples import statistics
from omnilab_studies.trajectory.front_end import Step, scaled
from omnilab_studies.trajectory.loop_evaluation import Judged
from omnilab_studies.trajectory.mapping_run import Way

REJECTED = 0.5  # a loop closure that counts less than this is


# ------------------------------------------------------------------------------------------------------------- metrics
def errors_of(errors: Mapping[str, Evaluation], final: list[str]) -> list[Metric]:
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


def loops_of(judged: Judged | None, closures: Ints) -> list[Metric]:
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


def steps_of(way: Way) -> list[Metric]:
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


def counts_of(way: Way, final: Mapping[str, Optimized], factors: Floats, omitted: int) -> list[Metric]:
    rejected = {
        f"{name}_rejected": int((found.weights[way.mapper.loops] < REJECTED).sum()) for name, found in final.items()
    }
    length = [] if way.truth is None else [Metric("path_length", float(path_length(way.truth)[-1]), "m")]
    free = way.mapper.groups.max(initial=-1) >= 0
    return [
        Metric("images", len(way.steps), "1"),
        Metric("left_out", omitted, "1"),
        Metric("bridged_steps", sum(step.trouble != "" for step in way.steps), "1"),
        Metric(
            "problems",
            sum(len(step.warnings) for step in way.steps) + sum(len(f.warnings) for f in final.values()),
            "1",
        ),
        *length,
        *(Metric(name, count, "1") for name, count in rejected.items()),
        *(Metric(f"factor_{k}", float(factor), "1") for k, factor in enumerate(factors) if free),
    ]


# -------------------------------------------------------------------------------------------------------------- results
def off_m(way: Way, shown: Mapping[str, Floats]) -> dict[str, Floats]:
    """Metres (n,) that each trajectory's aligned positions are off."""
    if way.truth is None:
        return {}
    return {name: np.linalg.norm(poses[:, :2] - way.truth[:, :2, 3], axis=1) for name, poses in shown.items()}


def table_of(way: Way, shown: Mapping[str, Floats]) -> dict[str, Any]:
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


def closure_table(closures: Ints, judged: Judged | None) -> dict[str, Any]:
    table: dict[str, Any] = {"earlier": closures[:, 0], "later": closures[:, 1]}
    return table if judged is None else table | {"right": judged.right.astype(int)}


def files_of(way: Way, ways: Mapping[str, Floats], factors: Floats, last: str) -> dict[str, str]:
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
