"""Panoramic sensors: column 0 looks to the camera frame's +x, azimuth grows along the columns."""

from __future__ import annotations

from dataclasses import dataclass

from omnilab.api import setting
from omnilab.cameras import CylindricalCamera, EquirectangularCamera
from omnilab_mirror.sensors.virtual import VirtualCamera


@dataclass
class Cylindrical(VirtualCamera):
    """Images a virtual world on a cylinder: rows are spaced evenly in the tangent of the elevation."""

    width: int = setting(512, at_least=8, at_most=16_384)  # pixels
    height: int = setting(128, at_least=8, at_most=16_384)  # pixels
    lowest_deg: float = setting(-38.0, above=-90, below=90)  # elevation of the bottom edge
    highest_deg: float = setting(38.0, above=-90, below=90)  # elevation of the top edge
    start_deg: float = setting(180.0, at_least=-1e6, at_most=1e6)  # azimuth of column 0: ahead is in the middle
    clockwise: bool = True  # azimuth falls along the columns, as a viewer inside sees it

    @property
    def camera(self) -> CylindricalCamera:
        """The cylinder."""
        return CylindricalCamera(
            self.width, self.height, self.start_deg, self.clockwise, self.lowest_deg, self.highest_deg
        )


@dataclass
class Equirectangular(VirtualCamera):
    """Images a virtual world on the unit sphere: rows are spaced evenly in elevation."""

    width: int = setting(512, at_least=8, at_most=16_384)  # pixels
    height: int = setting(256, at_least=8, at_most=16_384)  # pixels
    lowest_deg: float = setting(-90.0, at_least=-90, at_most=90)  # elevation of the bottom edge
    highest_deg: float = setting(90.0, at_least=-90, at_most=90)  # elevation of the top edge
    start_deg: float = setting(180.0, at_least=-1e6, at_most=1e6)  # azimuth of column 0: ahead is in the middle
    clockwise: bool = True  # azimuth falls along the columns, as a viewer inside sees it

    @property
    def camera(self) -> EquirectangularCamera:
        """The sphere, or the part of it between two elevations."""
        return EquirectangularCamera(
            self.width, self.height, self.start_deg, self.clockwise, self.lowest_deg, self.highest_deg
        )
