"""The sensor `mirror`: a hyperbolic mirror and its camera in a virtual world."""

from __future__ import annotations

from dataclasses import dataclass

from omnilab.projection import HyperbolicMirror
from omnilab_mirror.virtual import VirtualCamera


@dataclass
class Mirror(VirtualCamera):
    """Images a virtual world through a hyperbolic mirror, from any pose (Berenguer, thesis, chapter 3.3).

    Rays are traced exactly, from the mirror's effective viewpoint; the viewpoint is the pose's origin.
    """

    size: int = 250  # pixels of a side
    crop: float = 0.5  # share of the mirror's diameter in the image; 1: all of it
    a_mm: float = 40.0  # the hyperbola's a
    b_mm: float = 160.0  # the hyperbola's b
    rim_mm: float = 41.0  # from the mirror's apex up to its rim

    @property
    def camera(self) -> HyperbolicMirror:
        """The mirror and its camera."""
        return HyperbolicMirror(self.size, self.crop, self.a_mm, self.b_mm, self.rim_mm)
