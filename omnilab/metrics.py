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


def distances_to(truth_m: Floats, places_m: Floats) -> Floats:
    """Metric distances (Q, P) from where queries were taken (Q, 3) to the places (P, 3)."""
    return np.asarray(np.linalg.norm(truth_m[:, None, :] - places_m[None, :, :], axis=-1))


def verdicts(distance_m: Floats, answer: Ints) -> npt.NDArray[np.str_]:
    """Score answers (Q,), indices of places, by the metric distances (Q, P) to all places (thesis, 4.5.1).

    "nearest": no place is more than 1 mm closer to the query than the answered one (half-way queries have several
    nearest places); "second": the answer is at the next distinct distance; "wrong": any other.
    """
    answered = distance_m[np.arange(len(answer)), answer]
    nearest = distance_m.min(axis=1)
    second = np.where(distance_m > nearest[:, None] + TIE_M, distance_m, np.inf).min(axis=1)
    return np.where(answered <= nearest + TIE_M, "nearest", np.where(answered <= second + TIE_M, "second", "wrong"))


def ranks(distance_m: Floats, field: Floats) -> Ints:
    """At which rank (Q,), from 1, the first of the truly nearest places comes when places are sorted by `field` (Q, P)."""
    nearest = distance_m <= distance_m.min(axis=1, keepdims=True) + TIE_M
    best = np.where(nearest, field, np.inf).min(axis=1)
    return 1 + np.asarray((field < best[:, None]).sum(axis=1))


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
