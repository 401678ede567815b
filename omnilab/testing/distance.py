"""The conformance check of distances."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from omnilab.api import Match, Signatures
from omnilab.testing.common import expect
from omnilab.testing.parts import signatures_for
from omnilab.testing.rules import CannotCheckError, Trial, Work, conform, rule


def check_distance(distance: Any, signatures: Signatures | None = None, equivariant: bool = True) -> None:
    """Shapes, finite, deterministic, chunks agree, a place is nearest to itself, rotations as they should be.

    `signatures` are places that the distance is made for, where it is neither for any nor for those of an installed
    descriptor; not `equivariant` if a rotation of the camera does not shift their last axis.
    """
    conform(DistanceTrial(distance, signatures, equivariant))


class DistanceTrial(Trial):
    """A distance and a few signatures, each a place and a query."""

    kind = "distance"

    def __init__(self, distance: Any, signatures: Signatures | None = None, equivariant: bool = True) -> None:
        super().__init__(distance)
        self._shown = None if signatures is None else (signatures, equivariant)

    @cached_property
    def shown(self) -> tuple[Signatures, bool]:
        return self._shown or signatures_for(self.given)

    @property
    def places(self) -> Signatures:
        return self.shown[0]

    @cached_property
    def index(self) -> Any:
        return self.component.prepare(self.places)

    @cached_property
    def match(self) -> Match:
        found: Match = self.component.match(self.places, self.index)
        return found

    def work(self) -> Work:
        index = self.given.prepare(self.places)
        return Work(lambda: self.given.match(self.places, index), len(self.places) ** 2, "pair")

    @rule("gives finite distances, and rotations in [-pi, pi) where it gives any, of every query to every place")
    def every_pair(self) -> None:
        count = len(self.places)
        expect(
            self.match.distance.shape == (count, count), f"distances have shape {self.match.distance.shape}, not (Q, P)"
        )
        rotation = self.match.rotation_rad
        expect(
            rotation is None or bool((rotation >= -np.pi).all() and (rotation < np.pi).all()),
            "rotations leave [-pi, pi); return omnilab.geometry.wrap_angle of them",
        )

    @rule("finds each place the nearest to itself")
    def itself(self) -> None:
        nearest = self.match.distance.argmin(axis=1)
        expect(bool((nearest == np.arange(len(self.places))).all()),
                "a place is not the nearest to itself; distances are smaller for what is more alike")  # fmt: skip

    @rule("gives the same distances each time")
    def deterministic(self) -> None:
        again = self.component.match(self.places, self.index)
        expect(np.array_equal(again.distance, self.match.distance),
                "the same signatures give other distances the second time; seed what is drawn by the settings")  # fmt: skip

    @rule("compares some of the queries as all of them")
    def some_of_them(self) -> None:
        some = len(self.places) // 2 - 1  # in single precision, a distance near 0 is rounding (see `Euclidean`)
        again, whole = self.component.match(self.places[:some], self.index).distance, self.match.distance
        expect(bool(np.allclose(again, whole[:some], rtol=1e-4, atol=1e-3 * whole.max())),
                "a part of the queries gives other distances than all of them; let no query enter another's distances,"
                " and learn from the places, in `prepare`")  # fmt: skip

    @rule("gives finite distances of signatures of zeros, which black images may have")
    def blank(self) -> None:
        self.component.match(Signatures(np.zeros_like(self.places.place)), self.index)  # the boundary looks at it

    @rule("says by how much the camera was turned: query heading minus place heading")
    def rotation(self) -> None:
        places, equivariant = self.shown
        if self.match.rotation_rad is None:
            raise CannotCheckError("it estimates no rotation")
        if not equivariant:
            raise CannotCheckError("a rotation does not shift the signatures that it is for")
        samples = places.place.shape[-1]
        for shift in (0, 1, samples // 3, samples - 1):
            rotated = Signatures(np.roll(places.place, -shift, axis=-1))  # the camera rotated to the left
            rotation = self.component.match(rotated, self.index).rotation_rad.diagonal()
            error = np.angle(np.exp(1j * (rotation - 2 * np.pi * shift / samples)))
            expect(bool((np.abs(error) < np.pi / samples).all()),
                    f"a turn by {shift} of {samples} samples is answered with {np.rad2deg(rotation)} degrees; a turn to the"
                    " left shifts the last axis to lower indices, and is positive")  # fmt: skip
