"""Catadioptric sensors: a mirror, and a camera below that looks up into it."""

from __future__ import annotations

from dataclasses import dataclass

from omnilab.api import Bytes, setting
from omnilab.cameras import ConicalMirror, EllipticMirror, HyperbolicMirror, ParabolicMirror, SphericalMirror
from omnilab.errors import ConfigError
from omnilab_mirror.sensors.virtual import VirtualCamera


@dataclass
class Mirror(VirtualCamera):
    """Images a virtual world through a hyperbolic mirror, from any pose (Berenguer, thesis, chapter 3.3).

    Rays are traced exactly, from the mirror's effective viewpoint; the viewpoint is the pose's origin. With `deck_radius_m`
    it sees the deck of the robot that carries it, at the same place in every image, as real mirrors do.
    """

    size: int = setting(250, at_least=8, at_most=8192)  # pixels of a side
    crop: float = setting(0.5, above=0, at_most=1)  # share of the mirror's diameter in the image; 1: all of it
    a_mm: float = setting(40.0, above=0)  # the hyperbola's a
    b_mm: float = setting(160.0, above=0)  # the hyperbola's b
    rim_mm: float = setting(41.0, above=0)  # from the mirror's apex up to its rim
    margin_px: int = setting(
        0, at_least=0, at_most=8192
    )  # black columns on the left and on the right: a frame wider than high
    deck_radius_m: float = setting(0.0, at_least=0, at_most=100)  # of the robot's round deck; 0: no robot is seen
    deck_below_m: float = setting(0.72, above=0, at_most=1000)  # the viewpoint: 1 m less the 0.28 m of a Pioneer 3-AT

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.depth and self.deck_radius_m > 0:
            raise ConfigError("sensor.depth=true knows no robot; give sensor.deck_radius_m=0, or sensor.depth=false")

    @property
    def _carrier(self) -> tuple[float, ...]:
        return (self.deck_radius_m, self.deck_below_m) if self.deck_radius_m > 0 else ()

    def _with_carrier(self, images: Bytes) -> Bytes:
        if not self._carrier:
            return images
        from omnilab_mirror.sensors.deck import with_deck

        return with_deck(images, self.camera, self.samples, self.deck_radius_m, self.deck_below_m)

    @property
    def camera(self) -> HyperbolicMirror:
        """The mirror and its camera."""
        return HyperbolicMirror(self.size, self.crop, self.a_mm, self.b_mm, self.rim_mm, margin_px=self.margin_px)


@dataclass
class Parabolic(VirtualCamera):
    """Images a virtual world through a parabolic mirror with an orthographic camera; the viewpoint is the pose's origin."""

    size: int = setting(250, at_least=8, at_most=8192)  # pixels of a side
    crop: float = setting(1.0, above=0, at_most=1)  # share of the mirror's diameter in the image; 1: all of it
    h_mm: float = setting(20.0, above=0)  # the mirror's radius at the height of its focus
    rim_mm: float = setting(30.0, above=0)  # from the mirror's apex up to its rim

    @property
    def camera(self) -> ParabolicMirror:
        """The mirror and its camera."""
        return ParabolicMirror(self.size, self.crop, self.h_mm, self.rim_mm)


@dataclass
class Spherical(VirtualCamera):
    """Images a virtual world through a ball. There is no viewpoint: the ball's lowest point is the pose's origin."""

    size: int = setting(250, at_least=8, at_most=8192)  # pixels of a side
    crop: float = setting(1.0, above=0, at_most=1)  # share of the mirror's diameter in the image; 1: all of it
    distance_mm: float = setting(100.0, above=0)  # from the camera's focus up to the mirror's apex
    rim_radius_mm: float = setting(35.0, above=0)  # where the mirror ends
    radius_mm: float = setting(40.0, above=0)  # of the ball

    @property
    def camera(self) -> SphericalMirror:
        """The mirror and its camera."""
        return SphericalMirror(self.size, self.crop, self.distance_mm, self.rim_radius_mm, self.radius_mm)


@dataclass
class Elliptic(VirtualCamera):
    """Images a virtual world through an ellipsoid. There is no viewpoint: its lowest point is the pose's origin."""

    size: int = setting(250, at_least=8, at_most=8192)  # pixels of a side
    crop: float = setting(1.0, above=0, at_most=1)  # share of the mirror's diameter in the image; 1: all of it
    distance_mm: float = setting(100.0, above=0)  # from the camera's focus up to the mirror's apex
    rim_radius_mm: float = setting(35.0, above=0)  # where the mirror ends
    a_mm: float = setting(40.0, above=0)  # semi-axis across
    b_mm: float = setting(50.0, above=0)  # semi-axis along the mirror's axis

    @property
    def camera(self) -> EllipticMirror:
        """The mirror and its camera."""
        return EllipticMirror(self.size, self.crop, self.distance_mm, self.rim_radius_mm, self.a_mm, self.b_mm)


@dataclass
class Conical(VirtualCamera):
    """Images a virtual world through a cone, tip down. There is no viewpoint: the tip is the pose's origin.

    It sees a ring of elevations around the horizon, from 90 - 2 half_angle_deg degrees upwards.
    """

    size: int = setting(250, at_least=8, at_most=8192)  # pixels of a side
    crop: float = setting(1.0, above=0, at_most=1)  # share of the mirror's diameter in the image; 1: all of it
    distance_mm: float = setting(20.0, above=0)  # from the camera's focus up to the tip
    rim_radius_mm: float = setting(30.0, above=0)  # where the mirror ends
    half_angle_deg: float = setting(55.0, above=0, below=90)  # between the axis and the mirror

    @property
    def camera(self) -> ConicalMirror:
        """The mirror and its camera."""
        return ConicalMirror(self.size, self.crop, self.distance_mm, self.rim_radius_mm, self.half_angle_deg)
