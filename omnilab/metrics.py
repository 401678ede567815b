"""Measures of localisation, each with its definition. Pure numpy."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from omnilab.geometry import wrap_angle

Floats = npt.NDArray[np.floating[Any]]
Ints = npt.NDArray[np.integer[Any]]

TIE_M = 1e-3  # places this much farther than the nearest one are as near
VERDICTS = ("nearest", "second", "wrong")


def verdicts(truth_m: Floats, places_m: Floats, answer: Ints) -> npt.NDArray[np.str_]:
    """Score answers (Q,), indices of places (P, 3), to queries taken at truth (Q, 3) (Berenguer, thesis, 4.5.1).

    "nearest": no place is more than 1 mm closer to the query than the answered one (half-way queries have several
    nearest places); "second": the answer is at the next distinct distance; "wrong": any other.
    """
    distance = np.linalg.norm(truth_m[:, None, :] - places_m[None, :, :], axis=-1)  # (Q, P)
    answered = distance[np.arange(len(answer)), answer]
    nearest = distance.min(axis=1)
    beyond = np.where(distance > nearest[:, None] + TIE_M, distance, np.inf)
    second = beyond.min(axis=1)
    return np.where(answered <= nearest + TIE_M, "nearest", np.where(answered <= second + TIE_M, "second", "wrong"))


def sharpness(field: Floats) -> Floats:
    """C = (mean - min) / (max - min) of the distances (Q, P) of each query to the map (thesis, eq. 4.6), (Q,).

    1: only the answer is near. 0 (by definition here) where all places are equally far.
    """
    low, high = field.min(axis=1), field.max(axis=1)
    spread = high - low
    return np.asarray(np.divide(field.mean(axis=1) - low, spread, out=np.zeros_like(low), where=spread > 0))


def heading_error(truth_rad: Floats, answer_rad: Floats) -> Floats:
    """Absolute angle between headings, in [0, pi]."""
    return np.abs(wrap_angle(answer_rad - truth_rad))
