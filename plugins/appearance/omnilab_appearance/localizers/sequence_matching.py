"""Localisation of a sequence by matching sequences: SeqSLAM."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from omnilab.api import Distance, Estimates, Floats, Places, Signatures, check_settings, setting
from omnilab.errors import ConfigError
from omnilab.geometry import heading_of, wrap_angle
from omnilab_appearance.localizers.nearest import Nearest

FLAT = 1e-9  # of the largest distance: windows that vary less are flat


@dataclass
class SequenceIndex:
    """The map, and what the last queries looked like in it."""

    places: Places
    distance: Distance
    prepared: Any
    recent: list[Floats] = field(default_factory=list)  # normalised distances (P,) of the last queries, oldest first


@dataclass
class SequenceMatching:
    """SeqSLAM (Milford & Wyeth, 2012): straight lines through the matrix of distances between the last queries and a route.

    The places are a route in the map's order, the queries one drive along it. Each query's distances are normalised among
    the `window` places around (local contrast: minus their mean, by their standard deviation), so that every stretch of
    the route has its best candidates. A place's score is the mean over the last `length` queries along the line that ends
    there, by the best of the constant speeds between `slowest` and `fastest`, in places per query; below 0: driven
    backwards. What a line leaves the map by counts as the worst place. The answer is the place of the least score.

    The paper has speeds from 0.8 to 1.2 times the usual one. Of motions by odometry it makes no use. Normalisation makes
    any stretch as good as any other: where places are close enough that distances fall smoothly over tens of them, short
    sequences are lost by it, and `window=null` (all places) is better.
    """

    length: int = setting(10, at_least=1, at_most=10_000)  # queries that are matched together, d_s
    window: int | None = setting(10, at_least=2)  # places that are normalised among, R_window; null: all
    slowest: float = setting(0.8, at_least=-1000, at_most=1000)  # V_min, places per query
    fastest: float = setting(1.2, at_least=-1000, at_most=1000)  # V_max
    speed_step: float = setting(0.04, at_least=1e-3, at_most=1000)  # V_step

    def __post_init__(self) -> None:
        check_settings(self)
        if self.slowest > self.fastest:
            raise ConfigError(f"slowest={self.slowest} is above fastest={self.fastest}; give a smaller slowest")

    def prepare(self, places: Places, distance: Distance) -> SequenceIndex:
        """The map, before the first query."""
        _, _, prepared = Nearest().prepare(places, distance)
        return SequenceIndex(places, distance, prepared)

    def locate(self, queries: Signatures, index: SequenceIndex) -> Estimates:
        """Match each query together with those before it."""
        assert index.places.T_world_camera is not None
        match = index.distance.match(queries, index.prepared)
        scores = np.empty(match.distance.shape, np.float32)
        for q, distance in enumerate(match.distance.astype(float)):
            index.recent = [*index.recent[1 - self.length :], self._normalized(distance)][-self.length :]
            scores[q] = self._scores(np.stack(index.recent[::-1]))
        best, every = scores.argmin(axis=1), np.arange(len(scores))
        poses, heading = index.places.T_world_camera[best], None
        if match.rotation_rad is not None:
            heading = wrap_angle(heading_of(poses) + match.rotation_rad[every, best])
        return Estimates(best, scores[every, best], poses[:, :3, 3], heading, scores)

    def track(self, queries: Signatures, index: SequenceIndex, motion: Floats) -> Estimates:  # noqa: ARG002
        """As `locate`: speeds are searched, not measured."""
        return self.locate(queries, index)

    def _normalized(self, distance: Floats) -> Floats:
        """Distances (P,) to the route, of local contrast."""
        size = len(distance) if self.window is None else min(self.window, len(distance))
        starts = (np.arange(len(distance)) - size // 2).clip(0, len(distance) - size)
        around = np.lib.stride_tricks.sliding_window_view(distance, size)[starts]
        spread = around.std(axis=1)
        flat = spread <= FLAT * np.abs(distance).max()
        return np.where(flat, 0.0, (distance - around.mean(axis=1)) / np.where(flat, 1.0, spread))

    def _scores(self, recent: Floats) -> Floats:
        """Least mean (P,) of the normalised distances (n, P), newest first, along a line that ends at each place."""
        count, places = recent.shape
        worst = recent.max(axis=1)
        scores = np.full(places, np.inf)
        for speed in np.arange(self.slowest, self.fastest + self.speed_step / 2, self.speed_step):
            at = np.arange(places) - np.round(speed * np.arange(count)).astype(int)[:, None]
            inside = (at >= 0) & (at < places)
            line = np.take_along_axis(recent, at.clip(0, places - 1), axis=1)
            scores = np.minimum(scores, np.where(inside, line, worst[:, None]).mean(axis=0))
        return scores
