"""Two fisheye lenses back to back in one picture, as 360-degree cameras take it before it is stitched."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from omnilab.api import Circle, Floats
from omnilab.cameras.base import CentralCamera
from omnilab.cameras.kannala_brandt import KannalaBrandtCamera
from omnilab.cameras.plausibility import check_frame, check_numbers
from omnilab.errors import ConfigError
from omnilab.geometry import rotation_xyz

FRONT, BACK = (0.0, 0.0, 0.0), (0.0, 0.0, 180.0)


@dataclass(frozen=True, kw_only=True)
class DualFisheyeCamera(CentralCamera):
    """Two circles in one picture: a lens that looks ahead, along +x, and one that looks back.

    A lens is its circle, `[cx, cy, radius]` in pixels, at whose rim the angle to its axis is half of `fov_deg`. Within, the
    radius in the picture is an odd polynomial of the angle t, t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8) up to a factor, as in
    `KannalaBrandtCamera`; with no coefficients it grows with the angle, as fisheyes are mostly built.

    How a lens is mounted is `[roll, pitch, yaw]` in degrees: `Rz(yaw) Ry(pitch) Rx(roll)` turns a lens that looks ahead, its
    picture upright, into the way it looks. Both have one viewpoint, the origin: of things as near as the lenses are to each
    other nothing is right. A direction that both show is taken from the lens whose axis is nearer. There is no image circle:
    the radius of `circle` is 0, as of a panorama.
    """

    width: int
    height: int
    front_px: tuple[float, ...]
    back_px: tuple[float, ...]
    fov_deg: float = 190.0  # of each lens
    front_k: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    back_k: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    front_rpy_deg: tuple[float, ...] = FRONT
    back_rpy_deg: tuple[float, ...] = BACK

    def __post_init__(self) -> None:
        check_frame(self.width, self.height)
        check_numbers(self)
        if not 90 <= self.fov_deg <= 300:
            raise ConfigError(
                f"fov_deg={self.fov_deg:g} is no field of view of such a lens; give degrees, from 90 to 300"
            )
        for name, count in {"px": 3, "k": 4, "rpy_deg": 3}.items():
            for lens in ("front", "back"):
                if len(numbers := getattr(self, f"{lens}_{name}")) != count:
                    raise ConfigError(f"{lens}_{name} holds {len(numbers)} numbers; give {count}")
        for name, model in zip(("front", "back"), self._lenses, strict=True):
            if np.deg2rad(self.fov_deg) / 2 > model.largest_angle_rad:
                raise ConfigError(
                    f"{name}_k={list(getattr(self, f'{name}_k'))} maps angles to radii but up to"
                    f" {np.rad2deg(model.largest_angle_rad):.0f} degrees from the axis, and fov_deg={self.fov_deg:g} shows"
                    " more; give a smaller fov_deg, or other coefficients"
                )

    @property
    def circle(self) -> Circle:
        return Circle((self.width - 1) / 2, (self.height - 1) / 2, 0.0)

    @property
    def elevations_rad(self) -> tuple[float, float]:
        return -np.pi / 2, np.pi / 2

    def directions(self, pixels: Floats) -> Floats:
        """Of pixels of both circles; where they overlap, those of the nearer one."""
        uv = np.asarray(pixels, float)
        front, back = (lens.directions(uv) @ R.T for lens, R in zip(self._lenses, self._R_camera_lens, strict=True))
        nearer = self._away(uv, self.front_px) <= self._away(uv, self.back_px)
        return np.where(nearer[..., None], front, back)

    def pixels(self, directions: Floats) -> Floats:
        d = np.asarray(directions, float)
        front, back = (lens.pixels(d @ R) for lens, R in zip(self._lenses, self._R_camera_lens, strict=True))
        ahead = d @ self._R_camera_lens[0][:, 0] >= d @ self._R_camera_lens[1][:, 0]  # the nearer axis
        first, second = np.where(ahead[..., None], front, back), np.where(ahead[..., None], back, front)
        return np.where(np.isnan(first), second, first)

    def flipped(self) -> Self:
        def lens(px: tuple[float, ...]) -> tuple[float, ...]:
            return (self.width - 1 - px[0], *px[1:])

        def turn(rpy: tuple[float, ...]) -> tuple[float, ...]:
            return (-rpy[0], rpy[1], -rpy[2])

        return replace(
            self,
            front_px=lens(self.front_px),
            back_px=lens(self.back_px),
            front_rpy_deg=turn(self.front_rpy_deg),
            back_rpy_deg=turn(self.back_rpy_deg),
        )

    @cached_property
    def _lenses(self) -> tuple[KannalaBrandtCamera, KannalaBrandtCamera]:
        front, back = ((self.front_px, self.front_k), (self.back_px, self.back_k))
        return self._lens(*front), self._lens(*back)

    def _lens(self, px: tuple[float, ...], k: tuple[float, ...]) -> KannalaBrandtCamera:
        cx, cy, radius = px
        half = np.deg2rad(self.fov_deg) / 2
        focal = radius / (half * (1 + half**2 * (k[0] + half**2 * (k[1] + half**2 * (k[2] + half**2 * k[3])))))
        names = {f"k{i + 1}": value for i, value in enumerate(k)}
        return KannalaBrandtCamera(
            width=self.width,
            height=self.height,
            cx=cx,
            cy=cy,
            looks="ahead",
            rim_px=radius,
            fx=focal,
            fy=focal,
            **names,
        )

    @cached_property
    def _R_camera_lens(self) -> tuple[Floats, Floats]:
        return _rotation(self.front_rpy_deg), _rotation(self.back_rpy_deg)

    @staticmethod
    def _away(uv: Floats, px: tuple[float, ...]) -> Floats:
        return np.asarray(np.hypot(uv[..., 0] - px[0], uv[..., 1] - px[1]))


def _rotation(rpy_deg: tuple[float, ...]) -> Floats:
    """Rz(yaw) Ry(pitch) Rx(roll), which takes directions of a lens that looks ahead to the camera's."""
    return rotation_xyz(*-np.deg2rad(rpy_deg)).T


def side_by_side(width: int, height: int, fov_deg: float = 190.0) -> DualFisheyeCamera:
    """The camera of pictures whose halves hold the inscribed circles of both lenses: front left, back right, both upright."""
    radius = min(width / 4, height / 2)
    front, back = (((i + 0.5) * width / 2 - 0.5, (height - 1) / 2, radius) for i in range(2))
    return DualFisheyeCamera(width=width, height=height, front_px=front, back_px=back, fov_deg=fov_deg)
