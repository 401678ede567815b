"""Dioptric sensors: a lens or two, or any calibrated camera."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omnilab.api import setting
from omnilab.cameras import (
    BrownConradyCamera,
    FisheyeCamera,
    KannalaBrandtCamera,
    OCamCamera,
    PinholeCamera,
    RayCamera,
    StereoCamera,
    UnifiedCamera,
    load_camera,
)
from omnilab_mirror.sensors.virtual import VirtualCamera


@dataclass
class Pinhole(VirtualCamera):
    """Images a virtual world with a conventional camera, by default one that looks ahead along the camera frame's +x."""

    width: int = setting(320, at_least=8, at_most=16_384)  # pixels
    height: int = setting(240, at_least=8, at_most=16_384)  # pixels
    focal_px: float = setting(200.0, above=0)  # focal length in pixels
    looks: str = "ahead"  # or up, down

    @property
    def camera(self) -> PinholeCamera:
        """The camera, its axis in the middle of the image."""
        return PinholeCamera(focal_px=self.focal_px, looks=self.looks, **middle(self.width, self.height))


@dataclass
class BrownConrady(VirtualCamera):
    """Images a virtual world with a conventional camera and its lens's distortion, as OpenCV and ROS calibrate it."""

    width: int = setting(320, at_least=8, at_most=16_384)  # pixels
    height: int = setting(240, at_least=8, at_most=16_384)  # pixels
    fx: float = setting(200.0, above=0)  # focal length along u in pixels
    fy: float = setting(200.0, above=0)  # and along v
    cx: float = setting(159.5, at_least=-1e6, at_most=1e6)  # where the axis meets the image, in pixels
    cy: float = setting(119.5, at_least=-1e6, at_most=1e6)  # pixels
    k1: float = setting(-0.2)  # distortion along the radius, by its square
    k2: float = setting(0.03)  # by its fourth power
    p1: float = setting(0.0)  # distortion aside, mostly along v
    p2: float = setting(0.0)  # mostly along u
    k3: float = setting(0.0)  # by the sixth power of the radius
    k4: float = setting(0.0)  # of the rational model: by its square, below the line
    k5: float = setting(0.0)  # by its fourth power
    k6: float = setting(0.0)  # and by its sixth
    looks: str = "ahead"  # or up, down

    @property
    def camera(self) -> BrownConradyCamera:
        """The camera."""
        return BrownConradyCamera(
            width=self.width, height=self.height, cx=self.cx, cy=self.cy, looks=self.looks, fx=self.fx, fy=self.fy,
            k1=self.k1, k2=self.k2, p1=self.p1, p2=self.p2, k3=self.k3, k4=self.k4, k5=self.k5, k6=self.k6,
        )  # fmt: skip


@dataclass
class Stereo(VirtualCamera):
    """Images a virtual world with two conventional cameras that look ahead, side by side in one picture, the left one left.

    The pose is in the middle between them.
    """

    width: int = setting(640, at_least=16, at_most=16_384, multiple_of=2)  # pixels of both halves together
    height: int = setting(240, at_least=8, at_most=16_384)  # pixels
    focal_px: float = setting(200.0, above=0)  # focal length in pixels
    baseline_m: float = setting(0.12, above=0)  # from one camera to the other

    @property
    def camera(self) -> StereoCamera:
        """Both cameras."""
        return StereoCamera(width=self.width, height=self.height, focal_px=self.focal_px, baseline_m=self.baseline_m)


@dataclass
class Fisheye(VirtualCamera):
    """Images a virtual world with an equidistant fisheye lens, by default a half-space that is seen looking up."""

    size: int = setting(250, at_least=8, at_most=8192)  # pixels of a side
    focal_px: float = setting(79.0, above=0)  # pixels from the middle for each radian from the axis
    looks: str = "up"  # or down, ahead

    @property
    def camera(self) -> FisheyeCamera:
        """The camera, which shows the largest circle that the image holds."""
        return FisheyeCamera(
            focal_px=self.focal_px, looks=self.looks, rim_px=self.size / 2, **middle(self.size, self.size)
        )


@dataclass
class KannalaBrandt(VirtualCamera):
    """Images a virtual world with a fisheye lens of four coefficients (Kannala & Brandt, 2006; OpenCV, Kalibr, ROS)."""

    width: int = setting(250, at_least=8, at_most=16_384)  # pixels
    height: int = setting(250, at_least=8, at_most=16_384)  # pixels
    fx: float = setting(79.0, above=0)  # pixels along u for each radian from the axis, near it
    fy: float = setting(79.0, above=0)  # and along v
    cx: float = setting(124.5, at_least=-1e6, at_most=1e6)  # where the axis meets the image, in pixels
    cy: float = setting(124.5, at_least=-1e6, at_most=1e6)  # pixels
    k1: float = setting(-0.02)  # by the third power of the angle to the axis
    k2: float = setting(0.005)  # by its fifth power
    k3: float = setting(0.0)  # by its seventh
    k4: float = setting(0.0)  # by its ninth
    skew: float = setting(0.0, at_least=-1e6, at_most=1e6)  # pixels of u for each radian along v
    looks: str = "up"  # or down, ahead
    rim_px: float | None = setting(124.5, above=0)  # radius of the circle that shows the world; null: all there is

    @property
    def camera(self) -> KannalaBrandtCamera:
        """The camera."""
        return KannalaBrandtCamera(
            width=self.width, height=self.height, cx=self.cx, cy=self.cy, looks=self.looks, rim_px=self.rim_px,
            fx=self.fx, fy=self.fy, k1=self.k1, k2=self.k2, k3=self.k3, k4=self.k4, skew=self.skew,
        )  # fmt: skip


@dataclass
class Unified(VirtualCamera):
    """Images a virtual world with any central camera of the unified model (Mei & Rives, 2007): K, xi and distortion."""

    width: int = setting(250, at_least=8, at_most=16_384)  # pixels
    height: int = setting(250, at_least=8, at_most=16_384)  # pixels
    fx: float = setting(40.0, above=0)  # focal length along u in pixels
    fy: float = setting(40.0, above=0)  # and along v
    cx: float = setting(124.5, at_least=-1e6, at_most=1e6)  # where the axis meets the image, in pixels
    cy: float = setting(124.5, at_least=-1e6, at_most=1e6)  # pixels
    xi: float = setting(0.9, at_least=0)  # 0: a pinhole; 1: a parabolic mirror
    skew: float = setting(0.0, at_least=-1e6, at_most=1e6)  # pixels of u for each unit of y
    k1: float = setting(0.0)  # distortion along the radius, by its square
    k2: float = setting(0.0)  # and by its fourth power
    p1: float = setting(0.0)  # distortion aside, mostly along v
    p2: float = setting(0.0)  # mostly along u
    looks: str = "down"  # or up, ahead
    rim_px: float | None = setting(
        124.5, above=0
    )  # radius of the circle that shows the world; null: as far as frame and model reach

    @property
    def camera(self) -> UnifiedCamera:
        """The camera."""
        return UnifiedCamera(
            width=self.width, height=self.height, cx=self.cx, cy=self.cy, looks=self.looks, rim_px=self.rim_px,
            fx=self.fx, fy=self.fy, xi=self.xi, skew=self.skew, k1=self.k1, k2=self.k2, p1=self.p1, p2=self.p2,
        )  # fmt: skip


@dataclass
class OCam(VirtualCamera):
    """Images a virtual world with a camera that the OCamCalib toolbox calibrated (Scaramuzza and others, 2006)."""

    file: str = "???"  # path of a calib_results.txt
    looks: str = "down"  # or up, ahead
    rim_px: float | None = setting(
        None, above=0
    )  # radius of the circle that shows the world; null: as far as frame and model reach
    inner_px: float = setting(0.0, at_least=0)  # inside this radius the camera sees itself

    @property
    def camera(self) -> OCamCamera:
        """The camera in the file."""
        return OCamCamera.from_file(Path(self.file), self.looks, self.rim_px, self.inner_px)


@dataclass
class Calibrated(VirtualCamera):
    """Images a virtual world with the camera of a file: camera.json, or what a calibration tool wrote (docs/cameras.md)."""

    file: str = "???"  # path of the camera's file
    looks: str | None = None  # where the file leaves it open: down, up or ahead; null: ahead of pinholes, else down
    entry: str | None = None  # which camera of a calibration with several, such as cam1
    distortion: str | None = None  # of OpenCV's files that do not say: radtan (pinhole) or equidistant (fisheye)
    size_px: list[int] | None = setting(None, at_least=8, count=2)  # width and height, if the file does not say

    @property
    def camera(self) -> RayCamera:
        """The camera in the file."""
        size = None if self.size_px is None else (self.size_px[0], self.size_px[1])
        return load_camera(self.file, self.looks, self.entry, self.distortion, size)


def middle(width: int, height: int) -> dict[str, Any]:
    """The frame of a camera whose axis is in the middle of the image."""
    return {"width": width, "height": height, "cx": (width - 1) / 2, "cy": (height - 1) / 2}
