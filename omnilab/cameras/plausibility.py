"""Whether numbers make a camera: finite, of a size that cameras have, and such that it sees something."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from omnilab.api import CalibratedCamera, Floats
from omnilab.errors import ConfigError

LARGEST = 1e12  # of any number of a camera; pixels, millimetres and coefficients are far below
LARGEST_SIDE = 2**16  # pixels of an image
SHORTEST_PX = 0.01  # focal length, at least
FEWEST = 4  # pixels that see, of those that are tried
SMALLEST_PX = 1.0  # radius of the circle that shows the world, at least; panoramas have none
NARROWEST = 1e-7  # between the directions of two pixels far apart, at least


def check_frame(width: int, height: int) -> None:
    """ConfigError if an image of this size is none."""
    if width < 8 or height < 8:
        raise ConfigError(f"an image of {brief(width)} x {brief(height)} pixels is too small; give at least 8 x 8")
    if max(width, height) > LARGEST_SIDE:
        raise ConfigError(
            f"an image of {brief(width)} x {brief(height)} pixels is too large; give at most {LARGEST_SIDE} a side"
        )


def check_numbers(camera: Any) -> None:
    """ConfigError if a number among the settings of a camera (a dataclass) is not finite, or of no camera's size."""
    for name, value in _numbers(camera):
        if not abs(value) <= LARGEST:  # NaN is not
            raise ConfigError(f"{name}={brief(value)} is no number of a camera; give a finite one, up to {LARGEST:g}")


def check_positive(camera: Any, *names: str) -> None:
    """ConfigError unless these settings can be focal lengths, in pixels."""
    for name in names:
        value = getattr(camera, name)
        if not value >= SHORTEST_PX:
            raise ConfigError(f"{name}={brief(value)} is no focal length; give pixels, {SHORTEST_PX} or more")


def check_sees(camera: CalibratedCamera) -> None:
    """ConfigError if few pixels of a camera see directions of their own, as with lengths that are far too large or small."""
    uv = _sample(camera)
    try:
        with np.errstate(all="ignore"):
            directions = camera.directions(uv)
            back = camera.pixels(directions)
            seen = np.abs(np.linalg.norm(directions, axis=-1) - 1) < 1e-6
            seen &= np.hypot(*np.moveaxis(back - uv, -1, 0)) < 1e-2
            apart = np.linalg.norm(directions[seen, None] - directions[seen], axis=-1) + 2 * np.eye(seen.sum())
            sees = (apart.min(-1, initial=2.0) > NARROWEST).sum() >= max(FEWEST, 0.5 * seen.sum())
            sees &= not 0 < camera.circle.radius < SMALLEST_PX
            sees = bool(sees) and bool(np.isfinite(getattr(camera, "elevations_rad", 0.0)).all())
    except ArithmeticError:  # numbers of Python, not of NumPy
        sees = False
    if not sees:
        settings = ", ".join(f"{name}={brief(value)}" for name, value in _numbers(camera))
        raise ConfigError(
            f"a {type(camera).__name__} of these numbers sees nothing ({settings}); one of them is far too large or too"
            " small, or in another unit: give pixels for what is in the image, millimetres for mirrors"
        )


def _sample(camera: CalibratedCamera) -> Floats:
    """Pixels (n, 2) of the frame: of a coarse grid, and on rings within the circle."""
    width, height, ring = camera.width, camera.height, camera.circle
    share = (np.arange(7) + 0.41) / 7  # none on an axis
    u, v = np.meshgrid(share * width - 0.5, share * height - 0.5)
    grid = np.stack([u.ravel(), v.ravel()], -1)
    azimuth, share = np.meshgrid(np.arange(8) * np.pi / 4 + 0.2, [0.12, 0.5, 0.88])
    radius = min(ring.radius, float(np.hypot(width, height)))
    away = ring.inner + share * (radius - ring.inner)
    rings = np.stack([ring.cx + away * np.cos(azimuth), ring.cy - away * np.sin(azimuth)], -1).reshape(-1, 2)
    inside = ((rings >= -0.5) & (rings <= np.array([width, height]) - 0.5)).all(-1)
    return np.concatenate([grid, rings[inside]])


def _numbers(camera: Any) -> list[tuple[str, float]]:
    """Name and value of every number among the settings of a dataclass; of a tuple, each."""
    found = []
    for field in fields(camera):
        value = getattr(camera, field.name)
        values = value if isinstance(value, tuple) else (value,)
        found += [(field.name, v) for v in values if isinstance(v, int | float) and not isinstance(v, bool)]
    return found


def brief(value: Any) -> str:
    """A value in at most some 40 characters; numbers in few digits, and none of them too long to be written."""
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, int) and value.bit_length() > 100:  # Python writes no number of many thousand digits
        return f"an integer of {value.bit_length()} bits"
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
