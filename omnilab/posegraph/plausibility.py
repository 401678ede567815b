"""Units and orders of pose-graph files: what reads well, but was written in another convention.

Each check compares readings by how well motions and poses agree, and is quiet where that does not decide.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np

from omnilab.api import Floats, PoseGraph
from omnilab.errors import DataError
from omnilab.posegraph.graph import dead_reckoning, is_loop, residuals

FULL_TURN = 6.5  # rad: beyond it a measured turn is no turn in radians
DISAGREE = 0.3  # mean steps and radians by which motions and poses are off, beyond which a reading is doubted
MIN_EDGES = 3  # that no accident makes agree
BETTER = 5.0  # how many times better another one must be


def check_convention(graph: PoseGraph, placed: bool, name: str) -> None:
    """DataError for headings in degrees, and for quaternions with w first. `placed`: the poses are the file's own."""
    if graph.planar:
        _check_degrees(graph, placed, name)
        return
    if parts := _written(graph, placed, _w_first):
        raise DataError(
            f"{name} has quaternions of {parts} that fit as qw qx qy qz and not as qx qy qz qw, the order that is read;"
            " write qw last"
        )


def _check_degrees(graph: PoseGraph, placed: bool, name: str) -> None:
    turns, odometry = np.abs(graph.motions[:, 2]), ~is_loop(graph)
    if (odometry & (turns > FULL_TURN)).any():
        worst = int(np.argmax(np.where(odometry, turns, 0)))
        i, j = graph.ids[graph.edges[worst]]
        raise DataError(
            f"{name} turns by {graph.motions[worst, 2]:.6g} from vertex {i} to the next, {j}, more than a full turn in"
            " radians; degrees are to be multiplied by pi / 180"
        )
    largest = max(turns.max(), np.abs(graph.poses[:, 2]).max() if placed else 0)
    if largest > FULL_TURN and (parts := _written(graph, placed, _degrees)):
        raise DataError(
            f"{name} has headings up to {largest:.6g}, and those of {parts} fit as degrees and not as radians, as they are"
            " read; multiply them by pi / 180"
        )


def _degrees(rows: Floats) -> Floats:
    """Poses or motions (n, 3) whose headings were read as radians and are degrees."""
    return rows * [1, 1, np.pi / 180]


def _w_first(rows: Floats) -> Floats:
    """Poses or motions (n, 7) whose quaternions were read as xyzw and are wxyz."""
    return rows[:, [0, 1, 2, 4, 5, 6, 3]]


def _written(graph: PoseGraph, placed: bool, otherwise: Callable[[Floats], Floats]) -> str:
    """Which parts of the file were written otherwise: "vertices", "edges", both, or "" where they were not, or none can tell."""
    as_read = _disagreement(graph, placed)
    if as_read <= DISAGREE:
        return ""
    readings = {}
    for vertices, edges in list(product([False, True], [False, True]))[1:]:
        if placed or (edges and not vertices):
            poses = otherwise(graph.poses) if vertices else graph.poses
            other = replace(graph, poses=poses, motions=otherwise(graph.motions) if edges else graph.motions)
            parts = " and ".join(["vertices"] * vertices + ["edges"] * edges)
            readings[parts] = _disagreement(other, placed)
    best = min(readings, key=lambda parts: readings[parts])
    return best if BETTER * readings[best] < as_read else ""


def _disagreement(graph: PoseGraph, placed: bool) -> float:
    """The median of how far poses and motions are off, in steps of the median length and radians.

    Poses that the file does not have are chained, and only loop closures tell; 0 where too few do.
    """
    edges = np.ones(len(graph.edges), bool) if placed else is_loop(graph)
    if edges.sum() < MIN_EDGES:
        return 0.0
    size = 2 if graph.planar else 3
    length = float(np.median(np.linalg.norm(graph.motions[:, :size], axis=1)))
    e = residuals(graph, graph.poses if placed else dead_reckoning(graph))[edges]
    e[:, :size] /= length if length > 0 else 1.0
    return float(np.median(np.linalg.norm(e, axis=1)))
