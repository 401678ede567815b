"""Maps that localizers make of their own: who makes them, how they fit the world, and how they are shown."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from omnilab.api import Embedder, Embedding, Floats, Graph, Ints, Parts, Signatures
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import Similarity
from omnilab_studies.common.methods import Method

REST, STRETCHED, COMPRESSED = np.array([198, 203, 212]), np.array([224, 49, 49]), np.array([40, 110, 230])
SPRINGS = 4  # of each point, to those that are most alike, that are shown
FULL = 0.5  # strain at which a spring has its full colour
STATES = 40  # of a map on its way, that are shown
STATE_NS = 50_000_000  # between two of them, in the logs


class FittedMap(NamedTuple):
    """A map that was fitted to the world, beside the truth."""

    truth_m: Floats  # (n, 2)
    found_m: Floats  # (n, 2)


def makers_of(parts: Parts) -> dict[str, Embedder]:
    """The run's localizers, by name; ConfigError if one of them makes no maps."""
    for name, localizer in parts.localizers.items():
        if not isinstance(localizer, Embedder):
            raise ConfigError(
                f"localizers.{name} is a {type(localizer).__name__}, which makes no map of its own; leave it out with"
                f" localizers.{name}=null and choose some that do: +localizer@localizers.ANY=spring or smacof"
            )
    return dict(parts.localizers)  # type: ignore[arg-type]  # just checked


def warm_up(makers: Iterable[Embedder]) -> None:
    """Let what is compiled at first use be so before anything is timed."""
    triangle = np.array([[[0.0, 2, 3], [2, 0, 2], [3, 2, 0]]])
    for maker in makers:
        maker.embed(triangle, np.random.default_rng(0), STATES)


def arranged(maker: Embedder, distance: Floats, seeds: Iterable[int]) -> list[Embedding]:
    """A map (B, n, n) from each start; a maker that draws nothing, and says so with its second map, is asked no further."""
    made: list[Embedding] = []
    for seed in seeds:
        same = len(made) > 1 and np.array_equal(made[0].position, made[1].position)
        made.append(made[0] if same else maker.embed(distance, np.random.default_rng(seed)))
    return made


def pair_distances(method: Method, signatures: Signatures) -> Floats:
    """The distances (n, n) among signatures, both ways averaged, 0 on the diagonal; DataError if there are none."""
    index = method.distance.prepare(signatures)
    found = method.distance.match(signatures, index).distance.astype(np.float64)
    if not np.isfinite(found).all():
        raise DataError(f"some distances of {method.name} are no numbers; leave it out")
    pairs = np.maximum((found + found.T) / 2, 0)  # rounding makes some of equal signatures negative
    np.fill_diagonal(pairs, 0)
    return pairs


def springs(position_m: Floats, length_m: Floats, edges: Ints) -> Graph:
    """Points (n, 3) and springs (E, 2) of natural lengths (n, n): stretched ones red, compressed ones blue.

    The colour is full where a spring is half as long again as its natural length, or half as long.
    """
    a, b = edges.T
    natural = length_m[a, b]
    apart = np.linalg.norm(position_m[a] - position_m[b], axis=1)
    strain = np.divide(apart - natural, natural, out=np.ones_like(natural), where=natural > 0)[:, None]
    strain = (strain / FULL).clip(-1, 1)
    colors = REST + np.abs(strain) * (np.where(strain > 0, STRETCHED, COMPRESSED) - REST)
    return Graph(position_m, edges, np.round(colors).astype(np.uint8))


def nearest_edges(length: Floats, count: int) -> Ints:
    """Each point's springs to the `count` points that are most alike (E, 2), each spring once; lengths (n, n)."""
    others = np.where(np.eye(len(length), dtype=bool), np.inf, length)
    near = np.argsort(others, axis=1, kind="stable")[:, : min(count, len(length) - 1)]
    ends = np.stack([np.repeat(np.arange(len(length)), near.shape[1]), near.ravel()], axis=1)
    return np.unique(np.sort(ends, axis=1), axis=0)


def settling(arrangement: Embedding, which: int, length: Floats, fit: Similarity, height_m: float) -> Iterator[Graph]:
    """The states of one of the maps on its way, each moved as the last one fits the world."""
    assert arrangement.steps is not None
    edges = nearest_edges(length, SPRINGS)
    for plane in arrangement.steps[:, which]:
        yield springs(raised(fit.apply(plane), height_m), float(fit.scale) * length, edges)


def raised(position_m: Floats, height_m: float) -> Floats:
    """Positions (n, 2) at a height, (n, 3)."""
    return np.column_stack([position_m, np.full(len(position_m), height_m)])
