"""The conformance checks of localizers, and of those that embed a map of their own."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from omnilab import api
from omnilab.api import Embedding, Estimates, Floats, Places, Signatures
from omnilab.geometry import planar_poses
from omnilab.testing.common import expect
from omnilab.testing.rules import CannotCheckError, Trial, Work, conform, rule


def check_localizer(localizer: Any) -> None:
    """Shapes, deterministic, a place is found where it is, batch equals one by one."""
    conform(LocalizerTrial(localizer))


def check_embedder(embedder: Any) -> None:
    """Shapes, deterministic, a plane's own distances are kept, infinite ones do not count, batch equals one by one."""
    expect(isinstance(embedder, api.Embedder), "has no `embed`")
    conform(LocalizerTrial(embedder))


class _PositionDistance:
    """Signatures that are positions: what a localizer should do with them is plain."""

    def prepare(self, places: Signatures) -> Floats:
        return places.place

    def match(self, queries: Signatures, index: Floats) -> api.Match:
        apart = np.linalg.norm(queries.place[:, None] - index[None], axis=-1).astype(np.float32)
        return api.Match(apart, np.zeros_like(apart))


class LocalizerTrial(Trial):
    """A localizer, twenty places of a grid that are also its queries, and sets of points to be embedded."""

    kind = "localizer"

    def __init__(self, localizer: Any) -> None:
        super().__init__(localizer)
        x, y = np.meshgrid(np.arange(5.0), np.arange(4.0))
        self.position_m = np.stack([x.ravel(), y.ravel(), np.ones(20)], axis=1)
        self.queries = Signatures(self.position_m.astype(np.float32))
        self.places = Places(self.queries, planar_poses(self.position_m), [str(i) for i in range(20)])
        position = np.random.default_rng(8).uniform(-1, 1, (3, 12, 2))
        self.apart = np.linalg.norm(position[:, :, None] - position[:, None], axis=-1)
        self.apart[0, 2, 9] = self.apart[0, 9, 2] = np.inf

    @cached_property
    def found(self) -> Estimates:
        """Of all queries at once."""
        estimates: Estimates = self.component.locate(self.queries, self._begun())
        return estimates

    def _begun(self) -> Any:
        """An index; one that remembers begins anew."""
        return self.component.prepare(self.places, _PositionDistance())

    @cached_property
    def embedded(self) -> Embedding:
        if not isinstance(self.given, api.Embedder):
            raise CannotCheckError("it embeds no map of its own")
        made: Embedding = self.component.embed(self.apart, np.random.default_rng(4), steps=7)
        return made

    def work(self) -> Work:
        index = self.given.prepare(self.places, _PositionDistance())
        return Work(lambda: self.given.locate(self.queries, index), len(self.queries), "query")

    @rule("estimates a position of each query")
    def each_query(self) -> None:
        expect(
            self.found.position_m.shape == (20, 3), f"positions have shape {self.found.position_m.shape}, not (Q, 3)"
        )

    @rule("recognises a place as itself")
    def itself(self) -> None:
        expect(bool((self.found.place == np.arange(20)).all()),
                "a place is not recognised as itself; smaller distances are of what is more alike")  # fmt: skip

    @rule("locates queries of a batch as one by one")
    def one_by_one(self) -> None:
        index = self._begun()
        single = np.concatenate([self.component.locate(self.queries[i : i + 1], index).position_m for i in range(20)])
        expect(bool(np.allclose(single, self.found.position_m)),
                "a batch gives other positions than its queries one by one; let no query enter another's estimate, but in"
                " `track`")  # fmt: skip

    @rule("embeds sets of points with the states on the way, and leaves the distances as they are")
    def embeds(self) -> None:
        made, given = self.embedded, (3, 12, 2)
        expect(made.position.shape == given, f"positions have shape {made.position.shape}, not (B, n, 2)")
        expect(made.steps is not None and made.steps.shape[1:] == given, "states on the way are not (S, B, n, 2)")
        assert made.steps is not None
        expect(bool(np.allclose(made.steps[-1], made.position)), "the last state on the way is not where they settled")
        expect(bool((made.iterations >= 0).all()), "iterations are below 0")

    @rule("keeps the distances of a plane, but for infinite ones, and says how well")
    def keeps_distances(self) -> None:
        position, given = self.embedded.position, self.apart
        apart = np.linalg.norm(position[:, :, None] - position[:, None], axis=-1)
        counts = np.isfinite(given)
        misfit = np.sqrt(np.sum((apart - given) ** 2, axis=(1, 2), where=counts))
        misfit /= np.sqrt(np.sum(given**2, axis=(1, 2), where=counts))
        stress = self.embedded.stress
        expect(bool(np.allclose(stress, misfit, atol=1e-6)), f"stress is {stress}, the positions have {misfit}")
        expect(bool((misfit < 0.05).all()), f"distances of a plane are kept with a stress of {misfit.max():.3f} only")

    @rule("embeds the same sets the same way each time, together and one by one")
    def embeds_alike(self) -> None:
        position = self.embedded.position
        again = self.component.embed(self.apart, np.random.default_rng(4))
        expect(np.array_equal(again.position, position), "the same seed makes another map the second time")
        single = [
            self.component.embed(self.apart[i : i + 1], np.random.default_rng(4)).position
            for i in range(len(self.apart))
        ]
        expect(bool(np.allclose(np.concatenate(single), position)), "a batch makes other maps than its sets one by one")
