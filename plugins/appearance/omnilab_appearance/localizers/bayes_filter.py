"""Localisation of a sequence: what was seen before counts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from omnilab.api import Distance, Estimates, Floats, Places, Signatures
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import heading_of, wrap_angle
from omnilab.metrics import spacing
from omnilab_appearance.localizers.nearest import Nearest

LEAST = 1e-6  # places less likely than this part of the likeliest are not carried on
FLOOR = 1e-30


@dataclass
class Following:
    """The map, and how likely each of its places is after the last query."""

    places: Places
    distance: Distance
    prepared: Any
    motion_m: float
    belief: Floats | None = None  # (P,), its sum is 1; None before the first query
    heading_rad: Floats | None = None  # (P,) of the camera at the last query, had it been at each of the places


@dataclass
class BayesFilter:
    """A discrete Bayes filter over the places (Thrun, Burgard and Fox, 2005, table 4.1): queries are one sequence, in order.

    Between two queries the camera moves by about `motion_m` any way or, where odometry tells the motion, by that, blurred
    as much: a map of places cannot hold less than its step. A part `lost` of the belief starts anew everywhere. A place at distance d is then weighed by
    exp(-certainty (d - min) / (median - min)), so that no distance needs a scale of its own. The answer is the likeliest
    place; distances to all places are -log of the belief.
    """

    motion_m: float | None = None  # standard deviation along each axis, from a query to the next; null: the map's step
    certainty: float = 12.0  # how much likelier the most alike place is than a middling one, as a logarithm
    lost: float = 0.01  # share of the belief that may be anywhere

    def __post_init__(self) -> None:
        if not ((self.motion_m is None or self.motion_m > 0) and self.certainty > 0 and 0 < self.lost < 1):
            raise ConfigError(
                f"motion_m={self.motion_m}, certainty={self.certainty:g}, lost={self.lost:g} follow nothing; give"
                " numbers above 0, and lost below 1"
            )

    def prepare(self, places: Places, distance: Distance) -> Following:
        """The map, before the first query."""
        _, _, prepared = Nearest().prepare(places, distance)
        assert places.T_world_camera is not None
        motion_m = spacing(places.T_world_camera[:, :3, 3]) if self.motion_m is None else self.motion_m
        if not motion_m > 0:
            raise DataError(f"the map's {len(places)} places have no step; give localizer.motion_m in metres")
        return Following(places, distance, prepared, motion_m)

    def locate(self, queries: Signatures, index: Following) -> Estimates:
        """Each query after the one before, the motion unknown."""
        return self.track(queries, index, np.full((len(queries), 3), np.nan))

    def track(self, queries: Signatures, index: Following, motion: Floats) -> Estimates:
        """Each query after the one before; motion (Q, 3) forward, left, counter-clockwise up to each, NaN if not known."""
        assert index.places.T_world_camera is not None
        match = index.distance.match(queries, index.prepared)
        place_heading = heading_of(index.places.T_world_camera)
        beliefs = np.empty(match.distance.shape)
        for q, distance in enumerate(match.distance):
            belief = self._predicted(index, motion[q]) * self._likelihood(distance)
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

    def _predicted(self, index: Following, motion: Floats) -> Floats:
        """Where the camera may be after the motion: the belief, moved and blurred."""
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
        """Of the places (P,), up to a factor; all alike where all distances are."""
        above = distance - distance.min()
        middling = np.median(above)
        return np.exp(-self.certainty * above / middling) if middling > 0 else np.where(above > 0, 0.0, 1.0) + FLOOR
