"""Localisation of a sequence by a discrete Bayes filter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from omnilab.api import Distance, Estimates, Floats, Places, Signatures, check_settings, setting
from omnilab.errors import DataError
from omnilab.geometry import heading_of, wrap_angle
from omnilab.metrics import spacing
from omnilab_appearance.localizers.nearest import Nearest

LEAST = 1e-6  # share of the largest belief below which places are not predicted from
FLOOR = 1e-30


@dataclass
class BayesFilterIndex:
    """The map, and the belief after the last query."""

    places: Places
    distance: Distance
    prepared: Any
    motion_m: float
    belief: Floats | None = None  # (P,), its sum is 1; None before the first query
    heading_rad: Floats | None = None  # (P,) of the camera at the last query, conditional on each place


@dataclass
class BayesFilter:
    """A discrete Bayes filter over the places (Thrun, Burgard and Fox, 2005, table 4.1): queries are one sequence, in order.

    Between two queries the camera moves by a normal distribution of standard deviation `motion_m`, about the motion of
    the odometry where there is one; the map's step bounds its resolution. A share `lost` of the belief is spread evenly.
    The likelihood of a place at distance d is exp(-certainty (d - min) / (median - min)), which is free of the distance's
    scale. The answer is the place of the largest belief; the distances are -log of the belief.
    """

    motion_m: float | None = setting(
        None, above=0
    )  # standard deviation along each axis, from a query to the next; null: the map's step
    certainty: float = setting(
        12.0, above=0, at_most=1e6
    )  # log likelihood ratio of the most alike place to one at the median distance
    lost: float = setting(0.01, above=0, below=1)  # share of the belief that is spread evenly

    def __post_init__(self) -> None:
        check_settings(self)

    def prepare(self, places: Places, distance: Distance) -> BayesFilterIndex:
        """The map, before the first query."""
        _, _, prepared = Nearest().prepare(places, distance)
        assert places.T_world_camera is not None
        motion_m = spacing(places.T_world_camera[:, :3, 3]) if self.motion_m is None else self.motion_m
        if not motion_m > 0:
            raise DataError(f"the map's {len(places)} places have no step; give localizer.motion_m in metres")
        return BayesFilterIndex(places, distance, prepared, motion_m)

    def locate(self, queries: Signatures, index: BayesFilterIndex) -> Estimates:
        """As `track`, with unknown motion."""
        return self.track(queries, index, np.full((len(queries), 3), np.nan))

    def track(self, queries: Signatures, index: BayesFilterIndex, motion: Floats) -> Estimates:
        """Filter queries in order; motion (Q, 3) forward, left, counter-clockwise up to each, NaN where unknown."""
        assert index.places.T_world_camera is not None
        match = index.distance.match(queries, index.prepared)
        place_heading = heading_of(index.places.T_world_camera)
        beliefs = np.empty(match.distance.shape)
        for q, distance in enumerate(match.distance):
            belief = self._predict(index, motion[q]) * self._likelihood(distance)
            beliefs[q] = index.belief = belief / belief.sum()
            if match.rotation_rad is not None:
                index.heading_rad = place_heading + match.rotation_rad[q]
        best, every = beliefs.argmax(axis=1), np.arange(len(beliefs))
        heading = None
        if match.rotation_rad is not None:
            heading = wrap_angle(place_heading[best] + match.rotation_rad[every, best])
        field = -np.log(np.maximum(beliefs, FLOOR)).astype(np.float32)
        position = index.places.T_world_camera[best, :3, 3]
        return Estimates(best, field[every, best], position, heading, field)

    def _predict(self, index: BayesFilterIndex, motion: Floats) -> Floats:
        """Prediction: the belief (P,), moved and convolved with a Gaussian."""
        from scipy.spatial.distance import cdist

        assert index.places.T_world_camera is not None
        position = index.places.T_world_camera[:, :3, 3]
        if index.belief is None:
            return np.full(len(position), 1 / len(position))
        likely = index.belief > LEAST * index.belief.max()
        moved = position[likely].copy()
        if np.isfinite(motion).all() and index.heading_rad is not None:
            c, s = np.cos(index.heading_rad[likely]), np.sin(index.heading_rad[likely])
            moved[:, 0] += c * motion[0] - s * motion[1]
            moved[:, 1] += s * motion[0] + c * motion[1]
        reach = np.exp(-0.5 * cdist(moved, position, "sqeuclidean") / index.motion_m**2)
        reach /= np.maximum(reach.sum(axis=1, keepdims=True), FLOOR)
        return np.asarray((1 - self.lost) * (index.belief[likely] @ reach) + self.lost / len(position))

    def _likelihood(self, distance: Floats) -> Floats:
        """The likelihood of places (P,), up to a factor; uniform where all distances are equal."""
        above = distance - distance.min()
        middling = np.median(above)
        return np.exp(-self.certainty * above / middling) if middling > 0 else np.where(above > 0, 0.0, 1.0) + FLOOR
