"""Handedness and horizon of pictures with poses, estimated from the optical flow between neighbours."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from omnilab.api import Bytes, Floats, Ints
from omnilab.geometry import heading_of, wrap_angle
from omnilab_recordings.poses.positions import Positions

BASES = 24  # images that are compared with neighbours, from all over the recording
LARGEST_TURN_RAD = np.deg2rad(15.0)  # between neighbours
ACROSS_RAD = np.deg2rad(40.0)  # least angle between the two moves that start in one image
FARTHER = 2.0  # times the nearest neighbour's distance, that the second may be away
MARGIN = 64  # columns that a panorama is continued by
LEAST_PAIRS = 6
SLOWEST_PX, NEARER = 0.05, 1.5  # mean speed of a side that is believed; ratio of speeds by which the ground is known
AGREE, APART = 0.7, 0.3  # of mean resultant lengths: what a hypothesis needs, and needs more than the other


@dataclass(frozen=True)
class Handedness:
    """Mean resultant lengths (0: moves and drifts have nothing in common, 1: they agree) of the two hypotheses."""

    pairs: int
    as_taken: float
    mirrored: float
    turned_deg: float  # azimuth in the picture, once flipped if need be, of where yaw points: of the better hypothesis

    @property
    def is_mirrored(self) -> bool | None:
        """None: it cannot be decided."""
        best, other = max(self.as_taken, self.mirrored), min(self.as_taken, self.mirrored)
        known = self.pairs >= LEAST_PAIRS and best >= AGREE and best - other >= APART
        return self.mirrored > self.as_taken if known else None


def neighbours(positions: Positions) -> Ints:
    """Pairs (M, 2) of images: to the nearest of like heading, and to the nearest that lies across from there."""
    bases = np.unique(np.linspace(0, len(positions.images) - 1, BASES).astype(int))
    return np.array([pair for base in bases for pair in _from(base, positions)], np.int64).reshape(-1, 2)


def _from(base: int, positions: Positions) -> Iterator[tuple[int, int]]:
    moves = positions.position_m[:, :2] - positions.position_m[base, :2]
    away, headings = np.hypot(*moves.T), heading_of(positions.R_world_robot)
    usable = (away > 1e-6) & (np.abs(wrap_angle(headings - headings[base])) < LARGEST_TURN_RAD)
    order = np.flatnonzero(usable)[np.argsort(away[usable], kind="stable")]
    if len(order) == 0:
        return
    yield base, int(order[0])
    directions = np.arctan2(moves[order, 1], moves[order, 0])
    across = np.abs(np.sin(directions - directions[0])) > np.sin(ACROSS_RAD)
    across &= away[order] <= FARTHER * away[order[0]]
    if across.any():
        yield base, int(order[np.argmax(across)])


def moves_rad(positions: Positions, pairs: Ints) -> Floats:
    """Directions (M,) of the moves from the first to the second image of each pair, from where the robot's yaw points."""
    x, y = (positions.position_m[pairs[:, 1]] - positions.position_m[pairs[:, 0]])[:, :2].T
    return wrap_angle(np.arctan2(y, x) - heading_of(positions.R_world_robot[pairs[:, 0]]))


def drift_between(first: Bytes, second: Bytes) -> tuple[float, Floats]:
    """The azimuth that a camera moved to, as two panoramas (rows, columns) show it, and how fast rows part ahead.

    What is at azimuth b drifts sideways by some positive amount times sin(b - move); a turn adds a constant. Ahead, it
    rises above the horizon and sinks below it: the second answer (rows,) is in pixels downwards.
    """
    import cv2

    before, after = (np.hstack([p[:, -MARGIN:], p, p[:, :MARGIN]]) for p in (first, second))
    sideways, down = np.moveaxis(cv2.DISOpticalFlow.create(2).calc(before, after, None)[:, MARGIN:-MARGIN], -1, 0)
    drift, azimuth = np.median(sideways, axis=0), 2 * np.pi * np.arange(first.shape[1]) / first.shape[1]
    move = np.arctan2(-(drift * np.cos(azimuth)).sum(), (drift * np.sin(azimuth)).sum())
    return float(move), np.asarray(2 * (down * np.cos(azimuth - move)).mean(axis=1))


def handedness(drifts_rad: Floats, moves: Floats) -> Handedness:
    """Do drifts in the pictures (M,) turn with the moves of the robot (M,), or against them?"""
    with_moves = np.exp(1j * (drifts_rad - moves)).mean() if len(moves) else 0j
    against = np.exp(1j * (np.pi - drifts_rad - moves)).mean() if len(moves) else 0j  # once flipped
    offset = np.angle(max(with_moves, against, key=abs))
    return Handedness(len(moves), float(abs(with_moves)), float(abs(against)), float(np.rad2deg(offset)))


@dataclass(frozen=True)
class Horizon:
    """Where rows part when the camera moves."""

    level: float  # in the panorama, from its bottom edge (0) to its top edge (1)
    below: float  # speeds of what is below and above, in pixels of the panorama
    above: float

    @property
    def upright(self) -> bool | None:
        """Whether what is below is nearer, as the ground is. None: it cannot be decided."""
        fast, slow = max(self.below, self.above), min(self.below, self.above)
        return self.below > self.above if fast > NEARER * slow else None


def horizon(parting: Floats) -> Horizon | None:
    """The row that neither rises nor sinks, from what M pairs of panoramas show of their rows (M, rows)."""
    if len(parting) < LEAST_PAIRS:
        return None
    down = parting.mean(axis=0)
    row = int(np.argmin(np.cumsum(down))) + 1
    if not 0 < row < len(down) or -down[:row].mean() < SLOWEST_PX or down[row:].mean() < SLOWEST_PX:
        return None
    return Horizon(1 - row / len(down), float(down[row:].mean()), float(-down[:row].mean()))
