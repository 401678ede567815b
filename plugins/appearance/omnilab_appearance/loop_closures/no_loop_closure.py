"""No loop closures: a trajectory by odometry alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Closures, Frames, ImageFeatures, Unusable
from omnilab_appearance.loop_closures.hog_threshold import no_closures


@dataclass
class NoLoopClosure:
    """Recognises no place, so that the map is what odometry makes of the trajectory: what others are compared with."""

    def begin(self) -> NoPlaces:
        """A database that keeps nothing."""
        return NoPlaces()


class NoPlaces:
    """Place database that recognises nothing."""

    def query(
        self,
        frames: Frames,  # noqa: ARG002
        features: ImageFeatures | Unusable | None,  # noqa: ARG002
        step: float,  # noqa: ARG002
        rng: np.random.Generator,  # noqa: ARG002
    ) -> Closures:
        """See `omnilab.api.PlaceDatabase`."""
        return no_closures(0)
