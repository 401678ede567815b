"""The camera models that are fitted: which settings are free, of what size each is, and a start for them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from omnilab.api import Floats
from omnilab.cameras.base import looking
from omnilab.cameras.kannala_brandt import KannalaBrandtCamera
from omnilab.cameras.lenses import AxialCamera, UnifiedCamera
from omnilab.cameras.ocam import OCamCamera
from omnilab.errors import ConfigError

RAYS = (40, 16)  # angles to the axis and azimuths at which two cameras are compared


@dataclass(frozen=True)
class CameraModel:
    """A camera model and those of its settings that are fitted; the others keep their defaults.

    Settings are fitted in units in which they are of the order of one: pixels as shares of `radius_px`, half the
    picture's diagonal. A polynomial's coefficients are the settings a0, a2 ...; a1 is 0 (Scaramuzza et al., 2006).
    """

    name: str
    family: type[AxialCamera]
    free: tuple[str, ...]

    def scales(self, radius_px: float) -> Floats:
        """By what a fitted value is multiplied to be the setting."""
        powers = [1 - int(name[1:]) if name[0] == "a" else int(name in {"cx", "cy", "fx", "fy"}) for name in self.free]
        return np.asarray(radius_px ** np.array(powers, float))

    def camera(self, values: Floats, width: int, height: int) -> AxialCamera:
        """The camera of fitted values; ConfigError where they make none."""
        scales = self.scales(half_diagonal(width, height))
        settings: dict[str, object] = {
            name: float(value) for name, value in zip(self.free, values * scales, strict=True) if name[0] != "a"
        }
        if self.family is OCamCamera:
            settings["polynomial"] = self._polynomial(values * scales)
        return self.family(width=width, height=height, **settings)  # type: ignore[arg-type]

    def settings(self, camera: AxialCamera) -> Floats:
        """The free settings of a camera of this model, in its own units."""
        polynomial = getattr(camera, "polynomial", ())
        return np.array([polynomial[int(n[1:])] if n[0] == "a" else getattr(camera, n) for n in self.free], float)

    def start(self, focal_px: float, width: int, height: int) -> Floats:
        """Fitted values near those of an equidistant lens of this focal length."""
        guess = {
            "cx": (width - 1) / 2, "cy": (height - 1) / 2, "fx": focal_px, "fy": focal_px,
            "c": 1.0, "a0": -focal_px, "a2": 1 / (3 * focal_px),
        }  # fmt: skip
        if self.family is UnifiedCamera:
            guess |= {"xi": 1.0, "fx": 2 * focal_px, "fy": 2 * focal_px}
        settings = np.array([guess.get(name, 0.0) for name in self.free])
        return settings / self.scales(half_diagonal(width, height))

    def _polynomial(self, settings: Floats) -> tuple[float, ...]:
        orders = {
            int(name[1:]): float(value) for name, value in zip(self.free, settings, strict=True) if name[0] == "a"
        }
        return tuple(orders.get(order, 0.0) for order in range(max(orders) + 1))


_PLANE = ("fx", "fy", "cx", "cy")
MODELS: Mapping[str, CameraModel] = {
    model.name: model
    for model in (
        CameraModel("ocam", OCamCamera, ("a0", "a2", "a3", "a4", "cx", "cy", "c", "d")),
        CameraModel("unified", UnifiedCamera, (*_PLANE, "xi")),
        CameraModel("unified_radtan", UnifiedCamera, (*_PLANE, "xi", "k1", "k2", "p1", "p2")),
        CameraModel("kannala_brandt", KannalaBrandtCamera, (*_PLANE, "k1", "k2", "k3", "k4")),
    )
}


def half_diagonal(width: int, height: int) -> float:
    """Half the diagonal of a picture, in pixels."""
    return float(np.hypot(width, height) / 2)


def sample_rays(largest_rad: float, smallest_rad: float = 0.0) -> Floats:
    """Rays (n, 3), right, down and forward, spread over angles to the axis and around it."""
    angle = np.linspace(smallest_rad, largest_rad, RAYS[0] + 1)[1:, None]
    azimuth = np.arange(RAYS[1]) * 2 * np.pi / RAYS[1]
    return looking(azimuth, np.pi / 2 - angle).reshape(-1, 3)


def like(model: CameraModel, camera: AxialCamera, largest_rad: float) -> Floats:
    """Values of a model that shows rays up to an angle to the axis where a camera shows them, by least squares."""
    from scipy.optimize import least_squares

    size = camera.width, camera.height
    rays = sample_rays(largest_rad)
    shown = camera.image_points(rays)
    rays, shown = rays[good := np.isfinite(shown).all(-1)], shown[good]
    near = camera.image_points(looking(np.zeros(1), np.array([np.pi / 2 - 0.1])))[0, 0] - camera.cx

    def off(values: Floats) -> Floats:
        return (image_points(model, values, size, rays) - shown).ravel()

    return np.asarray(least_squares(off, model.start(float(near / 0.1), *size), x_scale="jac", jac="3-point").x)


def image_points(model: CameraModel, values: Floats, size: tuple[int, int], rays: Floats) -> Floats:
    """Where a model of these values shows rays; NaN everywhere where they make no camera."""
    try:
        return model.camera(values, *size).image_points(rays)
    except ConfigError:
        return np.full((*rays.shape[:-1], 2), np.nan)
