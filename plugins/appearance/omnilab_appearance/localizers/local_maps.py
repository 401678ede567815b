"""Base class of localizers by a local map: method 2 of the thesis, where positions only align the finished map."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

from omnilab.api import (
    Bools,
    Distance,
    Embedding,
    Estimates,
    Floats,
    Ints,
    Places,
    Signatures,
    check_settings,
    setting,
)
from omnilab.errors import DataError
from omnilab.geometry import procrustes, spanned
from omnilab_appearance.localizers.nearest import Nearest

log = logging.getLogger("omnilab")
STIFFEST = 100.0  # limit of the constants of eq. 14


class Constants(Enum):
    """The weight of a pair: the constant of its spring."""

    equal = "equal"
    inverse_square = "inverse_square"


@dataclass
class LocalMapLocalizer(ABC):
    """A localizer that embeds a query and its most alike places in a plane, from their distances alone.

    The distance that chooses the places measures the pairs among them, too. The similarity transform from the map to the
    world is fitted to the places alone and applied to the query. z is the mean of the places'. Where the places lie on
    one line, the side of it on which the query lies is ambiguous: a warning.
    """

    neighbours: int = setting(9, at_least=3, at_most=10_000)  # places that a query's map is made of, at least 3
    constants: Constants = Constants.equal  # of pairs: equal, or inverse_square: min(slope / distance², 100)
    slope: float | None = setting(
        None, above=0
    )  # of the distance's curve; null: the mean square of the map's distances, free of scale
    threshold: float | None = setting(None, above=0)  # pairs that are less alike do not count; null: all do
    linked: int | None = setting(
        None, at_least=1
    )  # pairs count where one is among the other's so many most alike; null: all do
    seed: int = setting(0, at_least=0, at_most=2**63 - 1)  # of what is drawn; every query gets the same draws

    def __post_init__(self) -> None:
        check_settings(self)

    def prepare(self, places: Places, distance: Distance) -> tuple[Places, Distance, Any]:
        """The map prepared for `nearest`."""
        index = Nearest().prepare(places, distance)
        if len(places) < self.neighbours:
            raise DataError(
                f"{self.neighbours} neighbours are more than the map's {len(places)} places;"
                " give fewer neighbours or a finer layout"
            )
        return index

    def locate(self, queries: Signatures, index: tuple[Places, Distance, Any]) -> Estimates:
        """Embed every query with its most alike places, align the places with their positions, apply that to the query."""
        places, distance, _ = index
        assert places.T_world_camera is not None
        nearest = Nearest().locate(queries, index)
        assert nearest.field is not None
        chosen = nearest.field.argsort(axis=1, kind="stable")[:, : self.neighbours]
        known = places.T_world_camera[chosen, :3, 3]
        _warn(spanned(known[..., :2]) < 2, "queries have their neighbours on one line, which their maps may be mirrored at;"
              " give more neighbours, or places in two dimensions")  # fmt: skip
        pairs = pairwise_distances(queries, chosen, places.signatures, distance)
        plane = self.embed(pairs, np.random.default_rng(self.seed)).position
        fit = procrustes(plane[:, :-1], known[..., :2])
        xy = fit.apply(plane[:, -1:])[:, 0]
        position_m = np.column_stack([xy, known[..., 2].mean(axis=1)])
        return Estimates(nearest.place, nearest.distance, position_m, nearest.heading_rad, nearest.field)

    def embed(self, distance: Floats, rng: np.random.Generator, steps: int = 0) -> Embedding:
        """Embed B sets of n points from distances (B, n, n), of which infinite ones do not count.

        All sets get the same draws of `rng`, so that a set comes out the same in any batch.
        """
        lengths, counts = self._checked(np.asarray(distance, float))
        lengths = np.where(counts, lengths, 0.0)
        position, iterations, states = self._embed(lengths, self._weights(lengths, counts), rng, steps)
        return Embedding(position, stress(position, lengths, counts), iterations, states)

    @abstractmethod
    def _embed(
        self, lengths: Floats, weights: Floats, rng: np.random.Generator, steps: int
    ) -> tuple[Floats, Ints, Floats | None]:
        """Positions (B, n, 2), iterations (B,) and states (S, B, n, 2) for lengths and weights (B, n, n)."""

    def _checked(self, distance: Floats) -> tuple[Floats, Bools]:
        """Symmetric distances, and a mask of those that count; DataError for unusable ones, warnings for ambiguous ones."""
        if distance.ndim != 3 or distance.shape[1] != distance.shape[2] or distance.shape[1] < 3:
            raise DataError(f"distances of shape {distance.shape} make no map; give (sets, n, n), n at least 3")
        apart = ~np.eye(distance.shape[1], dtype=bool)
        farthest = float(np.max(distance, initial=0, where=apart & np.isfinite(distance)))
        if not (distance[:, apart] >= -max(1e-5, 1e-3 * farthest)).all():  # just below 0 is rounding
            raise DataError("distances hold NaN or numbers below 0, so nothing can be arranged; check the descriptor")
        lengths = np.maximum(0.5 * (distance + distance.swapaxes(1, 2)), 0)
        counts = apart & np.isfinite(lengths) & (lengths <= (self.threshold or np.inf))
        if self.linked:
            counts &= most_alike(np.where(counts, lengths, np.inf), self.linked)
        longest = np.where(counts, lengths, -np.inf).max(axis=(1, 2))
        shortest = np.where(counts, lengths, np.inf).min(axis=(1, 2))
        alike = longest - shortest <= 1e-6 * longest
        _warn(alike, "maps have all distances equal, which determine no positions of their images; compare images by"
              " another distance")  # fmt: skip
        whole = connected(counts)
        most = max((parts_of(pairs) for pairs in counts[~whole]), default=1)
        _warn(~whole, f"maps fall into parts that no distance holds together, up to {most}; raise threshold or linked")
        return lengths, counts

    def _weights(self, lengths: Floats, counts: Bools) -> Floats:
        """The constants of the pairs (B, n, n), 0 where they do not count (Payá et al., 2016, eq. 14)."""
        ones: Floats = counts.astype(float)
        if self.constants is Constants.equal:
            return ones
        square = lengths**2
        pairs = np.maximum(counts.sum(axis=(1, 2), keepdims=True), 1)
        slope = self.slope or square.sum(axis=(1, 2), keepdims=True) / pairs
        capped = np.maximum(square, slope / STIFFEST)  # before dividing: images may be repeated
        return ones * np.divide(slope, capped, out=np.ones_like(capped), where=capped > 0)


def pairwise_distances(queries: Signatures, chosen: Ints, places: Signatures, distance: Distance) -> Floats:
    """Distances (Q, n + 1, n + 1) among the n chosen places (Q, n) of each query and, last, the query.

    The distance prepares each set as a map of its own, which matters for those fitted on the map (`log`).
    """
    pairs = np.empty((len(queries), chosen.shape[1] + 1, chosen.shape[1] + 1))
    for q, some in enumerate(chosen):
        both = Signatures(np.concatenate([places.place[some], queries.place[q : q + 1]]))
        pairs[q] = distance.match(both, distance.prepare(both)).distance
    return pairs


def most_alike(lengths: Floats, count: int) -> Bools:
    """Mask of pairs of lengths (B, n, n) that are among the `count` shortest of either point."""
    last = min(count, lengths.shape[1]) - 1
    near = lengths <= np.partition(lengths, last, axis=2)[:, :, last : last + 1]
    return np.asarray(near | near.swapaxes(1, 2))


def stress(position: Floats, lengths: Floats, counts: Bools) -> Floats:
    """The normalised stress (B,) of points (B, n, 2) over the pairs that count (B, n, n)."""
    x, y = np.moveaxis(position[:, :, None] - position[:, None], -1, 0)
    misfit = np.where(counts, np.hypot(x, y) - lengths, 0)
    total = (lengths**2).sum(axis=(1, 2), where=counts)
    return np.asarray(np.sqrt((misfit**2).sum(axis=(1, 2)) / np.where(total > 0, total, 1)))


def connected(pairs: Bools) -> Bools:
    """Whether the graph of the pairs (B, n, n) is connected, for each of the sets."""
    reached = np.zeros(pairs.shape[:2], bool)
    reached[:, 0] = True
    while (further := (pairs & reached[:, :, None]).any(axis=1) & ~reached).any():
        reached |= further
    return np.asarray(reached.all(axis=1))


def parts_of(pairs: Bools) -> int:
    """The number of parts of a graph of pairs (n, n)."""
    from scipy.sparse.csgraph import connected_components

    return int(connected_components(pairs, directed=False)[0])


def marks_of(iterations: Ints, steps: int) -> Ints:
    """Iterations (S, B) after which to keep a state: from the first to the last, densest at the start."""
    share = np.linspace(0, 1, max(steps, 2)) ** 2
    return np.asarray(np.rint(share[:, None] * iterations), np.int64)


def _warn(which: Bools, what: str) -> None:
    """Log a warning that counts the affected ones."""
    if which.any():
        log.warning("%d of %d %s", which.sum(), len(which), what)
