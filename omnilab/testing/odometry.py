"""The conformance check of odometries."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from omnilab import api
from omnilab.api import Frames, Motion
from omnilab.geometry import wrap_angle
from omnilab.posegraph.graph import inverse, vectors
from omnilab.testing.common import expect
from omnilab.testing.parts import path_frames
from omnilab.testing.rules import CannotCheckError, Trial, Work, conform, rule

SAME_TURN = np.deg2rad(30)  # how far an estimated turn may be from the true one, for its sign to be right


def check_odometry(odometry: Any, frames: Frames | None = None) -> None:
    """Frames of a short path (N at least 3, with poses) give the same one by one as in a batch; motions are sound.

    Deterministic by seed; covariances are positive definite; pickles. Without `frames` it is shown a short path through
    a small room, with poses, and must turn the right way.
    """
    conform(OdometryTrial(odometry, frames))


class OdometryTrial(Trial):
    """An odometry and frames of a short path."""

    kind = "odometry"

    def __init__(self, odometry: Any, frames: Frames | None = None) -> None:
        super().__init__(odometry)
        self.own_frames = frames is None
        self.frames = path_frames() if frames is None else frames

    @cached_property
    def extracted(self) -> Sequence[Any]:
        found: Sequence[Any] = self.component.extract(self.frames)
        expect(len(found) == len(self.frames) >= 3, f"{len(self.frames)} images are extracted as {len(found)}")
        expect(not any(isinstance(one, api.Unusable) for one in found), "good images are unusable")
        return found

    @cached_property
    def motions(self) -> list[Motion]:
        return self._estimates()

    def _estimates(self) -> list[Motion]:
        return [
            self.component.estimate(before, now, np.random.default_rng(1)) for before, now in pairwise(self.extracted)
        ]

    def work(self) -> Work:
        def call() -> None:
            for before, now in pairwise(self.given.extract(self.frames)):
                self.given.estimate(before, now, np.random.default_rng(1))

        return Work(call, len(self.frames) - 1, "motion")

    @rule("extracts what it needs of each image")
    def extracts(self) -> None:
        expect(len(self.extracted) == len(self.frames), "there is not one of each image")

    @rule("estimates motions with a unit and a positive covariance")
    def estimates(self) -> None:
        for motion in self.motions:
            expect(not motion.failed, f"the motion between two good images is not estimated: {motion.failed}")
            expect(motion.unit != "", "motions have no unit; say 'm', or what lengths count")

    @rule("estimates the same motion from the same seed")
    def deterministic(self) -> None:
        for one, other in zip(self.motions, self._estimates(), strict=True):
            expect(np.array_equal(one.vector, other.vector),
                    "the same seed gives another motion the second time; draw from `rng` alone")  # fmt: skip

    @rule("extracts an image alone as in a batch")
    def alone(self) -> None:
        (last,) = self.component.extract(self.frames.at(len(self.frames) - 1))
        single = self.component.estimate(self.extracted[-2], last, np.random.default_rng(1)).vector
        expect(bool(np.allclose(single, self.motions[-1].vector)),
                "an image extracted alone gives another motion than in a batch; let no image enter another's features")  # fmt: skip

    @rule("turns the way the camera turns: counter-clockwise is positive")
    def turns(self) -> None:
        T = self.frames.T_world_camera
        if T is None or not self.own_frames:
            raise CannotCheckError("how the camera moved is not known; without frames of your own it is")
        truth = vectors(inverse(T[:-1]) @ T[1:], planar=True)[:, 2]
        found = np.array([motion.vector[2] for motion in self.motions])
        expect(bool((np.abs(wrap_angle(found - truth)) < SAME_TURN).all()),
                f"the camera turns by {np.rad2deg(truth).round()} degrees and it says {np.rad2deg(found).round()}; a turn"
                " to the left is positive, seen from the image before")  # fmt: skip
