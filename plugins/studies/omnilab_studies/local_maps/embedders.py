"""Embedders of a run, and the pairwise image distances that they embed."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from omnilab.api import Embedder, Embedding, Floats, Parts, Signatures
from omnilab.errors import ConfigError, DataError
from omnilab_studies.common.methods import Method, check_comparisons

STATES = 40  # intermediate states of an embedding, that are shown


def embedders_of(parts: Parts) -> dict[str, Embedder]:
    """The run's localizers, by name; ConfigError if one of them is no embedder."""
    for name, localizer in parts.localizers.items():
        if not isinstance(localizer, Embedder):
            raise ConfigError(
                f"localizers.{name} is a {type(localizer).__name__}, which makes no map of its own; leave it out with"
                f" localizers.{name}=null and choose some that do: +localizer@localizers.ANY=spring or smacof"
            )
    return dict(parts.localizers)  # type: ignore[arg-type]  # just checked


def warm_up(embedders: Iterable[Embedder]) -> None:
    """Embed three points once: code that is compiled at first use is compiled before anything is timed."""
    triangle = np.array([[[0.0, 2, 3], [2, 0, 2], [3, 2, 0]]])
    for embedder in embedders:
        embedder.embed(triangle, np.random.default_rng(0), STATES)


def embed_from_seeds(embedder: Embedder, distance: Floats, seeds: Iterable[int]) -> list[Embedding]:
    """One embedding of distances (B, n, n) from each seed.

    If the second equals the first, the embedder draws nothing, and the first stands for all others.
    """
    found: list[Embedding] = []
    for seed in seeds:
        same = len(found) > 1 and np.array_equal(found[0].position, found[1].position)
        found.append(found[0] if same else embedder.embed(distance, np.random.default_rng(seed)))
    return found


def pairwise_distances(method: Method, signatures: Signatures) -> Floats:
    """Distances (n, n) among signatures, averaged over both directions, 0 on the diagonal; DataError for NaN or infinity."""
    check_comparisons(3 * len(signatures), len(signatures))  # in single precision and in double
    index = method.distance.prepare(signatures)
    found = method.distance.match(signatures, index).distance.astype(np.float64)
    if not np.isfinite(found).all():
        raise DataError(f"some distances of {method.name} are no numbers; leave it out")
    pairs = np.maximum((found + found.T) / 2, 0)  # rounding makes some of equal signatures negative
    np.fill_diagonal(pairs, 0)
    return pairs
