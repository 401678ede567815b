"""Geometry of a drive: its course, and errors along and across it."""

from __future__ import annotations

import numpy as np

from omnilab.api import Floats, Ints

LEAST = 0.5  # of the reach: positions that are closer together have no direction between them


def arc_length(position_m: Floats) -> Floats:
    """Distance travelled (N,) up to each position (N, 3)."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(position_m, axis=0), axis=1)))


def courses(position_m: Floats, reach_m: float) -> Floats:
    """Directions of travel (N,) in radians at positions (N, 3) in order, NaN where they are not known.

    Each is the direction from where the drive was `reach_m` before to where it was `reach_m` after, less at its ends. It is
    not known where the camera stood or turned back, beside a gap of more than twice the reach, and at NaN positions.
    """
    known = np.flatnonzero(np.isfinite(position_m).all(axis=1))
    course = np.full(len(position_m), np.nan)
    if len(known) < 2:
        return course
    own = position_m[known]
    along_m = arc_length(own)
    ends = [
        np.column_stack([np.interp(along_m + d, along_m, own[:, axis]) for axis in (0, 1)]) for d in (-reach_m, reach_m)
    ]
    move = ends[1] - ends[0]
    gap = np.diff(along_m) > 2 * reach_m
    beside = np.append(gap, False) | np.insert(gap, 0, False)
    clear = (np.linalg.norm(move, axis=1) >= LEAST * reach_m) & ~beside
    course[known[clear]] = np.arctan2(move[clear, 1], move[clear, 0])
    return course


def filled(course: Floats) -> Floats:
    """Courses (N,) with those that are not known taken from the nearest in order that is; 0 where none is."""
    known = np.flatnonzero(np.isfinite(course))
    if not len(known):
        return np.zeros_like(course)
    nearest = np.abs(np.subtract.outer(np.arange(len(course)), known)).argmin(axis=1)
    return np.asarray(course[known[nearest]])


def along_across(error_m: Floats, course: Floats) -> tuple[Floats, Floats]:
    """Components (Q,) of errors (Q, 3) along a course (Q,) in radians, and to its left."""
    c, s = np.cos(course), np.sin(course)
    return c * error_m[:, 0] + s * error_m[:, 1], c * error_m[:, 1] - s * error_m[:, 0]


def apart(position_m: Floats, step_m: float) -> Ints:
    """Indices of the positions (N, 3) that are at least a step from the one taken before, the first included."""
    taken = [0]
    for i, position in enumerate(position_m):
        if np.linalg.norm(position - position_m[taken[-1]]) >= step_m:
            taken.append(i)
    return np.array(taken)
