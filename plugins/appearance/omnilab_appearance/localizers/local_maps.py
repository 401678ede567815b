"""What localizers by a local map share: method 2 of the thesis, where positions only fit the finished map to the world."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
import numpy.typing as npt

from omnilab.api import Distance, Embedding, Estimates, Floats, Ints, Places, Signatures
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import procrustes, spanned
from omnilab_appearance.localizers.nearest import Nearest

log = logging.getLogger("omnilab")
STIFFEST = 100.0  # what eq. 14 limits the constants to
Flags = npt.NDArray[np.bool_]


class Constants(Enum):
    """How much a pair counts: the constant of its spring."""

    equal = "equal"
    inverse_square = "inverse_square"


@dataclass
class LocalMap(ABC):
    """A localizer that places a query and its most alike places in a plane, knowing only how unlike they are.

    The distance that chooses the places measures the pairs among them, too. The similarity that fits the map to the
    world is found on the places alone; the query goes along. z is the mean of the places'. Where the places lie on one
    line, the side of it on which the query lies cannot be told, and the log says so.
    """

    neighbours: int = 9  # places that a query's map is made of, at least 3
    constants: Constants = Constants.equal  # of pairs: equal, or inverse_square: min(slope / distance², 100)
    slope: float | None = None  # of the distance's curve; null: the mean square of the map's distances, free of scale
    threshold: float | None = None  # pairs that are less alike do not count; null: all do
    linked: int | None = None  # pairs count where one is among the other's so many most alike; null: all do
    seed: int = 0  # of what is drawn; every query gets the same draws

    def __post_init__(self) -> None:
        if self.neighbours < 3:
            raise ConfigError(f"neighbours={self.neighbours} place nothing in a plane; give at least 3")
        for name in ("slope", "threshold", "linked"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ConfigError(f"{name}={value:g} is not above 0; give a positive number or null")

    def prepare(self, places: Places, distance: Distance) -> tuple[Places, Distance, Any]:
        """The map as `nearest` keeps it."""
        index = Nearest().prepare(places, distance)
        if len(places) < self.neighbours:
            raise DataError(
                f"{self.neighbours} neighbours are more than the map's {len(places)} places;"
                " give fewer neighbours or a finer layout"
            )
        return index

    def locate(self, queries: Signatures, index: tuple[Places, Distance, Any]) -> Estimates:
        """Arrange every query with its most alike places, fit the places to their positions, answer where the query lies."""
        places, distance, _ = index
        assert places.T_world_camera is not None
        nearest = Nearest().locate(queries, index)
        assert nearest.field is not None
        chosen = nearest.field.argsort(axis=1, kind="stable")[:, : self.neighbours]
        known = places.T_world_camera[chosen, :3, 3]
        _tell(spanned(known[..., :2]) < 2, "queries have their neighbours on one line, which their maps may be mirrored at;"
              " give more neighbours, or places in two dimensions")  # fmt: skip
        pairs = pairwise(queries, chosen, places.signatures, distance)
        plane = self.embed(pairs, np.random.default_rng(self.seed)).position
        fit = procrustes(plane[:, :-1], known[..., :2])
        xy = fit.apply(plane[:, -1:])[:, 0]
        position_m = np.column_stack([xy, known[..., 2].mean(axis=1)])
        return Estimates(nearest.place, nearest.distance, position_m, nearest.heading_rad, nearest.field)

    def embed(self, distance: Floats, rng: np.random.Generator, steps: int = 0) -> Embedding:
        """Place B sets of n points from distances (B, n, n), of which infinite ones do not count.

        All sets get the same draws of `rng`, so that a set comes out the same in any batch.
        """
        lengths, counts = self._checked(np.asarray(distance, float))
        lengths = np.where(counts, lengths, 0.0)
        position, iterations, states = self._arrange(lengths, self._weights(lengths, counts), rng, steps)
        return Embedding(position, stress(position, lengths, counts), iterations, states)

    @abstractmethod
    def _arrange(
        self, lengths: Floats, weights: Floats, rng: np.random.Generator, steps: int
    ) -> tuple[Floats, Ints, Floats | None]:
        """Positions (B, n, 2), iterations (B,) and states (S, B, n, 2) for lengths and weights (B, n, n)."""

    def _checked(self, distance: Floats) -> tuple[Floats, Flags]:
        """Symmetric distances, and which of them count; what nothing can be made of is told."""
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
        _tell(alike, "maps have all distances equal, which tells nothing of where their images lie; compare images by"
              " another distance")  # fmt: skip
        _tell(~connected(counts), "maps fall into parts that no distance holds together; raise threshold or linked")
        return lengths, counts

    def _weights(self, lengths: Floats, counts: Flags) -> Floats:
        """The constants of the pairs (B, n, n), 0 where they do not count (Payá et al., 2016, eq. 14)."""
        ones: Floats = counts.astype(float)
        if self.constants is Constants.equal:
            return ones
        square = lengths**2
        pairs = np.maximum(counts.sum(axis=(1, 2), keepdims=True), 1)
        slope = self.slope or square.sum(axis=(1, 2), keepdims=True) / pairs
        capped = np.maximum(square, slope / STIFFEST)  # before dividing: images may be repeated
        return ones * np.divide(slope, capped, out=np.ones_like(capped), where=capped > 0)


def pairwise(queries: Signatures, chosen: npt.NDArray[np.intp], places: Signatures, distance: Distance) -> Floats:
    """Distances (Q, n + 1, n + 1) among the n chosen places (Q, n) of each query and, last, the query.

    The distance prepares each such set as a map of its own, which those that learn from the map (`log`) will notice.
    """
    pairs = np.empty((len(queries), chosen.shape[1] + 1, chosen.shape[1] + 1))
    for q, some in enumerate(chosen):
        both = Signatures(np.concatenate([places.place[some], queries.place[q : q + 1]]))
        pairs[q] = distance.match(both, distance.prepare(both)).distance
    return pairs


def most_alike(lengths: Floats, count: int) -> Flags:
    """Which pairs of lengths (B, n, n) are among the `count` shortest of one of their two."""
    last = min(count, lengths.shape[1]) - 1
    near = lengths <= np.partition(lengths, last, axis=2)[:, :, last : last + 1]
    return np.asarray(near | near.swapaxes(1, 2))


def stress(position: Floats, lengths: Floats, counts: Flags) -> Floats:
    """The normalised stress (B,) of points (B, n, 2) over the pairs that count (B, n, n)."""
    x, y = np.moveaxis(position[:, :, None] - position[:, None], -1, 0)
    misfit = np.where(counts, np.hypot(x, y) - lengths, 0)
    total = (lengths**2).sum(axis=(1, 2), where=counts)
    return np.asarray(np.sqrt((misfit**2).sum(axis=(1, 2)) / np.where(total > 0, total, 1)))


def connected(pairs: Flags) -> Flags:
    """Whether the pairs (B, n, n) join all points of a set, for each of the sets."""
    reached = np.zeros(pairs.shape[:2], bool)
    reached[:, 0] = True
    while (further := (pairs & reached[:, :, None]).any(axis=1) & ~reached).any():
        reached |= further
    return np.asarray(reached.all(axis=1))


def marks_of(iterations: Ints, steps: int) -> Ints:
    """After which iterations (S, B) to keep a state: from the first to the last, densest at the start, where most moves."""
    share = np.linspace(0, 1, max(steps, 2)) ** 2
    return np.asarray(np.rint(share[:, None] * iterations), np.int64)


def _tell(which: Flags, what: str) -> None:
    """A warning about some of many."""
    if which.any():
        log.warning("%d of %d %s", which.sum(), len(which), what)
