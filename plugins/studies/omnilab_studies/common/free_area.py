"""Free squares and windows of a grid, and query poses in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from omnilab.api import Floats, GridPoses, Ints, PathPoses, Plan, Sensor
from omnilab.errors import DataError
from omnilab.geometry import planar_poses
from omnilab_studies.common.scores import known_poses


def free_square(sensor: Sensor, side: int, step_m: float, center_m: Sequence[float], height_m: float | None) -> Plan:
    """`side` x `side` places of the sensor's grid, all of them free: those whose middle is nearest to `center_m`.

    DataError if there is no such square.
    """
    plan = sensor.plan(GridPoses(step_m, height_m=height_m))
    at = known_poses(plan.T_world_camera, "places")[:, :2, 3]
    corners = _corners(np.rint((at - at.min(axis=0)) / step_m).astype(int), side)
    if len(corners) == 0:
        raise DataError(
            f"the sensor has no {side} x {side} free places {step_m:g} m apart; give a smaller study.side or study.step_m"
        )
    middles = at[corners].mean(axis=1)
    best = int(np.linalg.norm(middles - np.asarray(center_m), axis=1).argmin())
    return plan.at(corners[best])


def _corners(nodes: Ints, side: int) -> Ints:
    """The indices (S, side * side) of the nodes (N, 2) of every square that is whole, row by row."""
    index = np.full(nodes.max(axis=0) + side, -1)
    index[tuple(nodes.T)] = np.arange(len(nodes))
    squares = np.lib.stride_tricks.sliding_window_view(index, (side, side)).transpose(0, 1, 3, 2)
    flat = squares.reshape(-1, side * side)
    return np.asarray(flat[(flat >= 0).all(axis=1)])


def window(position_m: Floats, step_m: float, nodes: Sequence[int], center_m: Sequence[float]) -> Ints:
    """Which of a grid's nodes (P, 2) lie in the window of at most `nodes` (x, y) that has the fewest gaps.

    Of several windows it is the one whose middle is nearest to `center_m`.
    """
    cells = np.rint((position_m - position_m.min(axis=0)) / step_m).astype(int)
    free = np.zeros(cells.max(axis=0) + 1, int)
    free[tuple(cells.T)] = 1
    size = np.minimum(nodes, free.shape)
    counts = np.lib.stride_tricks.sliding_window_view(free, tuple(size)).sum(axis=(2, 3))
    corners = np.argwhere(counts == counts.max())
    middles = position_m.min(axis=0) + (corners + (size - 1) / 2) * step_m
    corner = corners[np.linalg.norm(middles - np.asarray(center_m), axis=1).argmin()]
    return np.flatnonzero(((cells >= corner) & (cells < corner + size)).all(axis=1))


def positions_within(places: Plan, count: int, rng: np.random.Generator) -> Floats:
    """`count` positions (count, 3) drawn evenly from the square that the places span."""
    at = known_poses(places.T_world_camera, "places")[:, :3, 3]
    return rng.uniform(at.min(axis=0), at.max(axis=0), (count, 3))


def poses_with_headings(position_m: Floats, share: Floats, steps: int | None = None) -> PathPoses:
    """Poses at positions (N, 3) with headings from shares (N,) of a full turn; with `steps`, multiples of 2 pi / steps."""
    headings = share if steps is None else np.floor(share * steps) / steps
    return PathPoses(planar_poses(position_m, 2 * np.pi * headings))
