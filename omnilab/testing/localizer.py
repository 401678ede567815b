"""The conformance checks of localizers, and of those that embed a map of their own."""

from __future__ import annotations

from typing import Any

import numpy as np

from omnilab import api
from omnilab.api import Floats, Places, Signatures
from omnilab.geometry import planar_poses
from omnilab.testing.common import check_common, expect


class _PositionDistance:
    """Signatures that are positions: what a localizer should do with them is plain."""

    def prepare(self, places: Signatures) -> Floats:
        return places.place

    def match(self, queries: Signatures, index: Floats) -> api.Match:
        apart = np.linalg.norm(queries.place[:, None] - index[None], axis=-1).astype(np.float32)
        return api.Match(apart, np.zeros_like(apart))


def check_localizer(localizer: Any) -> None:
    """Shapes, deterministic, a place is found where it is, batch equals one by one."""
    localizer = check_common("localizer", localizer)
    x, y = np.meshgrid(np.arange(5.0), np.arange(4.0))
    position_m = np.stack([x.ravel(), y.ravel(), np.ones(20)], axis=1)
    signatures = Signatures(position_m.astype(np.float32))
    places = Places(signatures, planar_poses(position_m), [str(i) for i in range(20)])
    index = localizer.prepare(places, _PositionDistance())
    found = localizer.locate(signatures, index)
    expect(found.position_m.shape == (20, 3), f"positions have shape {found.position_m.shape}, not (Q, 3)")
    expect(bool((found.place == np.arange(20)).all()), "a place is not recognised as itself")
    single = np.concatenate([localizer.locate(signatures[i : i + 1], index).position_m for i in range(20)])
    expect(bool(np.allclose(single, found.position_m)), "a batch gives other positions than its queries one by one")


def check_embedder(embedder: Any) -> None:
    """Shapes, deterministic, a plane's own distances are kept, infinite ones do not count, batch equals one by one."""
    check_localizer(embedder)
    expect(isinstance(embedder, api.Embedder), "has no `embed`")
    position = np.random.default_rng(8).uniform(-1, 1, (3, 12, 2))
    given = np.linalg.norm(position[:, :, None] - position[:, None], axis=-1)
    given[0, 2, 9] = given[0, 9, 2] = np.inf
    before = given.copy()
    made = embedder.embed(given, np.random.default_rng(4), steps=7)
    expect(np.array_equal(given, before), "the distances that were given are changed")
    expect(made.position.shape == position.shape, f"positions have shape {made.position.shape}, not (B, n, 2)")
    expect(made.steps is not None and made.steps.shape[1:] == position.shape, "states on the way are not (S, B, n, 2)")
    expect(bool(np.allclose(made.steps[-1], made.position)), "the last state on the way is not where they settled")
    expect(bool((made.iterations >= 0).all()), "iterations are below 0")
    apart = np.linalg.norm(made.position[:, :, None] - made.position[:, None], axis=-1)
    counts = np.isfinite(given)
    misfit = np.sqrt(np.sum((apart - given) ** 2, axis=(1, 2), where=counts))
    misfit /= np.sqrt(np.sum(given**2, axis=(1, 2), where=counts))
    expect(bool(np.allclose(made.stress, misfit, atol=1e-6)), f"stress is {made.stress}, the positions have {misfit}")
    expect(bool((misfit < 0.05).all()), f"distances of a plane are kept with a stress of {misfit.max():.3f} only")
    again = embedder.embed(given, np.random.default_rng(4))
    expect(np.array_equal(again.position, made.position), "the same seed makes another map the second time")
    single = [embedder.embed(given[i : i + 1], np.random.default_rng(4)).position for i in range(len(given))]
    expect(
        bool(np.allclose(np.concatenate(single), made.position)), "a batch makes other maps than its sets one by one"
    )
