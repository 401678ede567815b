"""Cost of searching one map by a localizer: time, memory, compared signatures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, is_dataclass
from functools import partial
from typing import Any

import numpy as np

from omnilab.api import Distance, Floats, Ints, Localizer, Match, Places, Signatures
from omnilab_studies.common.timing import timed


@dataclass
class CountingDistance:
    """A distance that counts the pairs it compares."""

    distance: Distance
    pairs: int = 0

    def prepare(self, places: Signatures) -> Any:
        """As the counted distance."""
        return self.distance.prepare(places)

    def match(self, queries: Signatures, index: Any) -> Match:
        """As the counted distance."""
        found = self.distance.match(queries, index)
        self.pairs += found.distance.size
        return found


@dataclass(frozen=True)
class SearchCost:
    """A localizer's estimates for Q queries, one at a time, with time, memory and the number of compared signatures."""

    place: Ints  # (Q,)
    position_m: Floats  # (Q, 3)
    prepare_s: float
    index_bytes: int  # of the prepared map's arrays, beside the signatures
    query_ms: float  # the median
    compared: float  # signatures that a query is compared with, on average

    @classmethod
    def by(cls, localizer: Localizer, distance: Distance, places: Places, queries: Signatures) -> SearchCost:
        """Prepare the map, localise one query to warm up, then every query by itself, as a robot would."""
        distance.match(queries[:1], distance.prepare(places.signatures[:2]))  # imports and compiles
        counted = CountingDistance(distance)
        index, prepare_s = timed(lambda: localizer.prepare(places, counted))
        localizer.locate(queries[:1], index)
        counted.pairs = 0
        each = [queries[q : q + 1] for q in range(len(queries))]
        found = [timed(partial(localizer.locate, query, index)) for query in each]
        return cls(
            np.concatenate([estimates.place for estimates, _ in found]),
            np.concatenate([estimates.position_m for estimates, _ in found]),
            prepare_s,
            array_bytes(index, but=places),
            1e3 * float(np.median([seconds for _, seconds in found])),
            counted.pairs / len(queries),
        )

    def same(self, other: SearchCost) -> float:
        """The share of queries for which both estimate the same place."""
        return float(np.mean(self.place == other.place))

    def within(self, other: SearchCost, limit_m: float) -> float:
        """The share of queries whose two estimated positions lie within a limit."""
        return _share_within(self.position_m, other.position_m, limit_m)

    def recall(self, truth_m: Floats, limit_m: float) -> float:
        """The share of queries estimated within a limit of their true positions (Q, 3)."""
        return _share_within(self.position_m, truth_m, limit_m)


def _share_within(one_m: Floats, other_m: Floats, limit_m: float) -> float:
    return float(np.mean(np.linalg.norm(one_m - other_m, axis=1) <= limit_m * (1 + 1e-9)))


def array_bytes(thing: Any, but: Any = None) -> int:
    """The bytes of all arrays in nested tuples, lists, dicts and dataclasses, each once, without those of `but`."""
    seen: set[int] = set()
    _unseen_bytes(but, seen)
    return _unseen_bytes(thing, seen)


def _unseen_bytes(thing: Any, seen: set[int]) -> int:
    while isinstance(thing, np.ndarray) and isinstance(thing.base, np.ndarray):
        thing = thing.base  # a view holds the whole
    if id(thing) in seen:
        return 0
    seen.add(id(thing))
    match thing:
        case np.ndarray():
            return thing.nbytes
        case dict():
            parts = list(thing.values())
        case tuple() | list():
            parts = list(thing)
        case _:
            parts = list(vars(thing).values()) if is_dataclass(thing) else []
    return sum(_unseen_bytes(part, seen) for part in parts)


def exponent(sizes: Sequence[float], costs: Sequence[float]) -> float:
    """b of costs = a sizes^b, by least squares of the logarithms of costs above 0; NaN from less than two sizes."""
    known = [(size, cost) for size, cost in zip(sizes, costs, strict=True) if cost > 0]
    if len({size for size, _ in known}) < 2:
        return float("nan")
    x, y = np.log(known).T
    return float(np.polyfit(x, y, 1)[0])
