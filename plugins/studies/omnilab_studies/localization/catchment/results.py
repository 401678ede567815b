"""Catchment areas of reference places, and how far the visual compass holds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from omnilab.api import Bools, Floats, Ints, Metric
from omnilab.geometry import wrap_angle
from omnilab_studies.common.methods import key_of
from omnilab_studies.common.samples import of_known

NEAR = 1.5  # steps: positions closer than that are neighbours, of a grid the eight around


@dataclass(frozen=True)
class Catchments:
    """What one method finds around R references among N positions."""

    method: str
    difference: Floats  # (N, R) of the images
    away_m: Floats  # (N, R)
    caught: Bools  # (N, R) from where descending the difference leads to the reference
    size: Floats  # (R,) of what is caught, in m or m2
    off_deg: Floats | None  # (N, R) heading by the image - true heading
    compass_m: Floats | None  # (R,) up to which distance the compass points the right way


def neighbourhoods(position_m: Floats, step_m: float, on_path: bool) -> list[Ints]:
    """The neighbours of each position, itself first: on a path those before and after, else all within `NEAR` steps."""
    count = len(position_m)
    if on_path:
        return [np.array([i, *(j for j in (i - 1, i + 1) if 0 <= j < count)]) for i in range(count)]
    from scipy.spatial import KDTree

    pairs = KDTree(position_m).query_pairs(NEAR * step_m)
    near: list[list[int]] = [[i] for i in range(count)]
    for i, j in sorted(pairs):
        near[i].append(j)
        near[j].append(i)
    return [np.array(each) for each in near]


def caught(difference: Floats, neighbours: list[Ints], reference: int) -> Bools:
    """From which positions (N,) going to the neighbour of the least difference (N,), while there is a lesser one, ends at the reference."""
    step = np.array([near[difference[near].argmin()] for near in neighbours])
    while True:
        further = step[step]
        if (further == step).all():
            return np.asarray(step == reference)
        step = further


def compass_range(off_deg: Floats, away_m: Floats, limit_deg: float) -> float:
    """The distance of the nearest position from which the compass is off by more than the limit; the farthest of all, if none is."""
    wrong = np.abs(off_deg) > limit_deg
    return float(away_m[wrong].min() if wrong.any() else away_m.max())


def heading_off(rotation_rad: Floats, heading: Floats, references: Ints) -> Floats:
    """Errors (N, R), in degrees, of rotations (N, R) = heading - the reference's."""
    true = heading[:, None] - heading[references][None, :]
    return np.rad2deg(wrap_angle(rotation_rad - true))


def metrics_of(found: list[Catchments], unit: str, count: int, step_m: float) -> list[Metric]:
    """Catchments and compass of every method, over its references."""
    metrics = []
    for own in found:
        key = key_of(own.method)
        metrics += [
            Metric(f"{key}_catchment_median", float(np.median(own.size)), unit),
            Metric(f"{key}_catchment_share", float(own.caught.mean()), "1"),
        ]
        if own.compass_m is not None and own.off_deg is not None:
            metrics += [
                Metric(
                    f"{key}_compass_range_median", of_known(np.median, own.compass_m), "m", note="no heading is known"
                ),
                Metric(
                    f"{key}_compass_error_median",
                    of_known(np.median, np.abs(own.off_deg)),
                    "deg",
                    note="no heading is known",
                ),
            ]
    return [*metrics, Metric("places", count, "1"), Metric("map_step", step_m, "m")]


def rows_of(found: list[Catchments], position_m: Floats, references: Ints, keys: list[str]) -> list[dict[str, Any]]:
    """A row for each reference of each method."""
    return [
        {
            "method": own.method, "reference": int(i), "key": keys[i],
            "x_m": float(position_m[i, 0]), "y_m": float(position_m[i, 1]), "catchment": float(own.size[r]),
            "catchment_share": float(own.caught[:, r].mean()),
            "compass_range_m": float("nan") if own.compass_m is None else float(own.compass_m[r]),
            "compass_error_median_deg": float("nan") if own.off_deg is None else of_known(np.median, np.abs(own.off_deg[:, r])),
        }
        for own in found for r, i in enumerate(references)
    ]  # fmt: skip
