"""The conformance check of loop closures."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from omnilab.api import Closures, Frames
from omnilab.testing.common import expect
from omnilab.testing.parts import path_frames
from omnilab.testing.rules import Trial, Work, conform, rule


def check_loop_closure(closure: Any, frames: Frames | None = None) -> None:
    """Nodes are earlier ones, shapes agree, covariances are positive, two databases know nothing of each other; pickles.

    Without `frames` it is shown a small room, places of which come again.
    """
    conform(LoopClosureTrial(closure, frames))


class LoopClosureTrial(Trial):
    """A loop closure and frames, some of places that were shown before."""

    kind = "loop_closure"

    def __init__(self, closure: Any, frames: Frames | None = None) -> None:
        super().__init__(closure)
        self.frames = path_frames([0, 1, 2, 3, 0, 1]) if frames is None else frames

    @cached_property
    def closures(self) -> list[Closures]:
        return self._shown(self.component)

    def _shown(self, closure: Any) -> list[Closures]:
        """What it says of each frame, by a database of its own."""
        database, rng = closure.begin(), np.random.default_rng(1)
        return [database.query(self.frames.at(i), None, 0.1, rng) for i in range(len(self.frames))]

    def work(self) -> Work:
        return Work(lambda: self._shown(self.given), len(self.frames), "image")

    @rule("recognises images that came before, with motions and positive covariances")
    def earlier(self) -> None:
        for i, found in enumerate(self.closures):
            expect(
                bool((found.nodes < i).all()), f"image {i} is recognised as one that has not come before: {found.nodes}"
            )
            count = len(found.nodes)
            expect(found.distances.shape == (count,), f"distances have shape {found.distances.shape}, not (K,)")

    @rule("begins each database anew, and answers the same from the same seed")
    def deterministic(self) -> None:
        one, other = (
            [(found.nodes.tolist(), found.motions.tolist()) for found in closures]
            for closures in (self.closures, self._shown(self.component))
        )
        expect(one == other, "a second database answers otherwise than the first; keep what is seen in the database")
