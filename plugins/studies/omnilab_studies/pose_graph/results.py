"""Results of the study `pose_graph`: rows, metrics, tables, and the files of optima."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Floats, Ints, Metric, Optimized, PoseGraph
from omnilab.posegraph.files import g2o_text
from omnilab.posegraph.graph import chi2_quantile, edge_chi2, is_loop, matrices
from omnilab.trajectory.evaluation import Alignment, evaluate, rms
from omnilab.trajectory.files import tum_text
from omnilab_studies.common.tables import columns_of, markdown
from omnilab_studies.pose_graph import figures

METRICS = (
    "rms_to_clean_m",
    "ate_m",
    "chi2",
    "chi2_before",
    "wrong_rejected",
    "true_rejected",
    "rpe_metre_m",
    "drift",
    "scale",
    "iterations",
    "problems",
    "start_gap",
    "rejected",
    "trusted",
)  # which columns of the table are metrics, the most important first
METRIC_NAMES = (
    *(name.removesuffix("_m") for name in (*METRICS, "cost_from_START")),
    *(f"BACKEND_{name}".removesuffix("_m") for name in (*METRICS, "cost_from_START")),
    "poses", "edges", "loops", "wrong_loops",
)  # fmt: skip
SHOWN = {
    "backend",
    "rms_to_clean_m",
    "ate_m",
    "chi2",
    "start",
    "start_gap",
    "rejected",
    "wrong_rejected",
    "time_s",
}  # and which are in the viewer
UNLIKELY = 1e-6  # the share of graphs with sound edges whose chi2 is larger than what is said to be too large


class GraphTruth(NamedTuple):
    """What the optima of a pose graph are measured against, where it is known."""

    wrong: Ints  # (W,) edges that are wrong loop closures
    poses: Floats | None  # (N, k) the true poses
    clean_optimum: Floats | None  # (N, k) the optimum without wrong loop closures
    alignment: Alignment  # of an optimum with the true poses


def rows_of(
    graph: PoseGraph, optima: Mapping[str, Optimized], truth: GraphTruth, seconds: Mapping[str, float]
) -> list[dict[str, Any]]:
    """The table `backends`, row by row; `cost_from_START` is what each start led to, in columns that all rows have."""
    starts = sorted({f"cost_from_{start}" for one in optima.values() for start in one.starts})
    rows = [_row_of(name, graph, one, truth) for name, one in optima.items()]
    return [
        {**row, **{start: row.get(start, "") for start in starts}, "time_s": seconds[row["backend"]]} for row in rows
    ]


def _row_of(name: str, graph: PoseGraph, optimized: Optimized, truth: GraphTruth) -> dict[str, Any]:
    """The row of one back end in the table `backends`.

    `start_gap` is by how much more cost another start led to; it is empty where there was no choice, as `trusted` is where
    a back end does not say which edges it could not reject.
    """
    costs = list(optimized.starts.values())
    return {
        "backend": name,
        "chi2_before": optimized.chi2_before,
        "chi2": optimized.chi2,
        **(_rejection_rates(graph, optimized, truth.wrong) if len(truth.wrong) else {}),
        "iterations": optimized.iterations,
        "problems": len(optimized.warnings),
        "start": next(iter(optimized.starts), ""),
        "start_gap": max(costs) - min(costs) if costs else "",
        "rejected": int((optimized.rejected & is_loop(graph)).sum()),
        "trusted": "" if optimized.trusted is None else int(optimized.trusted.sum()),
        **_errors(optimized.poses, truth),
        **{f"cost_from_{start}": cost for start, cost in optimized.starts.items()},
    }


def _rejection_rates(graph: PoseGraph, optimized: Optimized, wrong: Ints) -> dict[str, float]:
    """Shares of the wrong and of the true loop closures that were rejected."""
    rejected = optimized.rejected
    true = np.setdiff1d(np.flatnonzero(is_loop(graph)), wrong)
    return {
        "wrong_rejected": float(rejected[wrong].mean()),
        "true_rejected": float(rejected[true].mean()) if len(true) else float("nan"),
    }


def _errors(poses: Floats, truth: GraphTruth) -> dict[str, float]:
    """The errors of poses (N, k), as far as the truth is known."""
    errors = {}
    if truth.clean_optimum is not None:
        size = 2 if poses.shape[1] == 3 else 3
        errors["rms_to_clean_m"] = rms(np.linalg.norm((poses - truth.clean_optimum)[:, :size], axis=1))
    if truth.poses is not None:
        error = evaluate(matrices(poses), matrices(truth.poses), truth.alignment)
        errors |= {
            "ate_m": error.ate_m,
            "rpe_metre_m": error.rpe_metre_m,
            "drift": error.drift,
            "scale": error.scale,
        }
    return errors


NOTES = {
    "true_rejected": "the graph has no true loop closure",
    "rpe_metre_m": "the true path is shorter than a metre",
    "drift": "the true path has no length",
}  # why there is no value, where there is none


def metrics_of(graph: PoseGraph, rows: Sequence[Mapping[str, Any]], wrong: Ints) -> list[Metric]:
    """Every row's numbers but the time, under the back end's name where there are several; not what a row leaves empty."""
    units = {"rms_to_clean_m": "m", "ate_m": "m", "rpe_metre_m": "m"}
    names = [name for name in METRICS if name in rows[0]]
    names += [name for name in rows[0] if name.startswith("cost_from_")]
    metrics = [
        Metric(
            f"{row['backend']}_{name}".removesuffix("_m") if len(rows) > 1 else name.removesuffix("_m"),
            float(row[name]), units.get(name, "1"), note=NOTES.get(name, ""),
        )
        for name in names for row in rows if row[name] != ""
    ]  # fmt: skip
    loops = int(is_loop(graph).sum()) - len(wrong)
    counts = {"poses": len(graph), "edges": len(graph.edges), "loops": loops, "wrong_loops": len(wrong)}
    return [*metrics, *(Metric(name, count, "1") for name, count in counts.items())]


def notes_of(graph: PoseGraph, optimized: Optimized) -> list[str]:
    """What a back end says of its start and of edges, and how the optimum fits."""
    return [*optimized.notes, *_fit(graph, optimized)]


def _fit(graph: PoseGraph, optimized: Optimized) -> list[str]:
    """A sentence where the edges that count fit worse than their information allows: chi2 beyond its 1 - 10^-6 quantile."""
    kept = ~optimized.rejected
    freedom = graph.information.shape[1] * (int(kept.sum()) - len(graph) + 1)
    if freedom <= 0:
        return []
    chi2, limit = float(edge_chi2(graph, optimized.poses)[kept].sum()), chi2_quantile(freedom, 1 - UNLIKELY)
    if chi2 <= limit:
        return []
    sentence = (
        f"chi2 {chi2:.6g} of the edges that count is more than their noise explains ({freedom} degrees of freedom, so"
        f" below {limit:.6g}): wrong loop closures, a local minimum, or information that is too large"
    )
    return [sentence]


def edge_table(graph: PoseGraph, optima: Mapping[str, Optimized], wrong: Ints) -> dict[str, Any]:
    """The table `edges`: each edge's nodes and kind, and by how many standard deviations it is off in each optimum."""
    ends = graph.ids[graph.edges]
    table: dict[str, Any] = {"from": ends[:, 0], "to": ends[:, 1], "loop": is_loop(graph).astype(int)}
    table["wrong"] = np.isin(np.arange(len(ends)), wrong).astype(int)
    for name, one in optima.items():
        table[f"{name}_deviations"] = figures.deviations(graph, one.poses).round(6)
        table[f"{name}_weight"] = one.weights.round(6)
    return table


def summary_of(
    graph: PoseGraph, rows: Sequence[Mapping[str, Any]], wrong: Ints, optima: Mapping[str, Optimized]
) -> str:
    """Size of the graph, the most important columns, and what the back ends say of their starts and of edges, as Markdown."""
    loops = int(is_loop(graph).sum())
    size = f"{len(graph)} poses, {len(graph.edges)} edges, {loops} of them loop closures, {len(wrong)} of these wrong"
    shown = {name: column for name, column in columns_of(rows).items() if name in SHOWN}
    notes = [f"- {name}: {sentence}" for name, one in optima.items() for sentence in notes_of(graph, one)]
    return "\n".join(["## Pose graph", "", size, "", markdown(shown), "", *notes])


def files_of(graph: PoseGraph, poses: Mapping[str, Floats]) -> dict[str, str]:
    """NAME.g2o and NAME.tum, a second a pose, of sets of poses (N, k) by name."""
    stamps_ns = np.arange(len(graph), dtype=np.int64) * 10**9
    texts = {}
    for name, at in poses.items():
        texts[f"{name}.g2o"] = g2o_text(replace(graph, poses=at))
        texts[f"{name}.tum"] = tum_text(matrices(at), stamps_ns)
    return texts
