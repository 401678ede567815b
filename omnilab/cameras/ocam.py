"""The camera that the OCamCalib toolbox calibrates, and its `calib_results.txt`."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from omnilab.api import Floats
from omnilab.cameras.lenses import AxialCamera, off_axis
from omnilab.errors import ConfigError, DataError
from omnilab.file_kinds import content_of

LARGEST_FILE = 65536  # bytes; real ones have about one thousand
MOST_COEFFICIENTS = 32
WHAT = {  # the word of the comment above a line, and what the line must hold
    "direct": "the polynomial's count and its coefficients",
    "center": "the centre's row and column",
    "affine": "the affine parameters c, d and e",
    "image size": "the image's height and width",
}


@dataclass(frozen=True, kw_only=True)
class OCamCamera(AxialCamera):
    """The polynomial model of the OCamCalib toolbox (Scaramuzza, Martinelli & Siegwart, 2006).

    A pixel at (down, right) from the centre is A (x, y) with A = [[c, d], [e, 1]], and looks to (x, y, f(rho)),
    rho = |(x, y)|, f(rho) = a0 + a1 rho + a2 rho^2 ... The toolbox's axes are x down, y right and z towards the viewer
    (a0 < 0); where a0 > 0 (some other tools) z points forward. The inverse is solved to machine precision; files also
    hold a polynomial that approximates it, which is not used. Beyond where the angle to the axis stops growing with rho
    the model has no rays.
    """

    polynomial: tuple[float, ...]  # a0, a1, a2 ..., in pixels
    c: float = 1.0
    d: float = 0.0
    e: float = 0.0

    def __post_init__(self) -> None:
        if not self.polynomial or self.polynomial[0] == 0:
            raise ConfigError(f"polynomial={self.polynomial} sees nothing at the centre; give a0, a1 ... with a0 not 0")
        if self.c - self.d * self.e <= 0:
            raise ConfigError(f"c={self.c:g}, d={self.d:g}, e={self.e:g} flatten the image; give c - d e above 0")
        super().__post_init__()

    @classmethod
    def from_file(
        cls, path: Path, looks: str = "down", rim_px: float | None = None, inner_px: float = 0.0
    ) -> OCamCamera:
        """The camera of a `calib_results.txt`; DataError that names the line that is missing or wrong."""
        found = read_calibration(path)
        (cy, cx), (c, d, e), (height, width) = found.center, found.affine, found.size
        try:
            return cls(
                width=width, height=height, cx=cx, cy=cy, looks=looks, rim_px=rim_px, inner_px=inner_px,
                polynomial=found.polynomial, c=c, d=d, e=e,
            )  # fmt: skip
        except ConfigError as error:
            raise DataError(f"{path}: {error}") from error

    @property
    def _reach_px(self) -> float:
        radius, _ = _angles(self.polynomial, self.width + self.height)
        return float(radius[-1])

    def _rays(self, offset: Floats) -> Floats:
        right, down = np.moveaxis(offset, -1, 0)
        x, y = np.array([down - self.d * right, self.c * right - self.e * down]) / (self.c - self.d * self.e)
        rho = np.hypot(x, y)
        rays = np.stack([y, x, forward(self.polynomial, rho)], -1)
        rays[rho > self._reach_px] = np.nan
        return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))

    def _offsets(self, rays: Floats) -> Floats:
        aside, angle = off_axis(rays)
        y, x = np.moveaxis(aside * self._radius(angle)[..., None], -1, 0)
        return np.stack([self.e * x + y, self.c * x + self.d * y], -1)

    def _radius(self, angle_rad: Floats) -> Floats:
        """rho at angles to the axis: looked up, then refined by Newton's method on rho cos = f(rho) sin."""
        radii, angles = _angles(self.polynomial, self.width + self.height)
        start = rho = np.interp(angle_rad, angles, radii)
        slope = tuple(i * a for i, a in enumerate(self.polynomial))[1:] or (0.0,)
        sin, cos = np.sin(angle_rad), np.cos(angle_rad)
        sign = np.sign(self.polynomial[0])
        for _ in range(4):
            error = rho * cos - forward(self.polynomial, rho) * sin
            with np.errstate(divide="ignore", invalid="ignore"):  # the slope is 0 where the model ends
                better = rho - error / (cos - sign * np.polyval(slope[::-1], rho) * sin)
            rho = np.clip(np.nan_to_num(better), start - radii[1], start + radii[1])
        return np.where(angle_rad <= angles[-1], rho, np.nan)

    def flipped(self) -> Self:
        return replace(super().flipped(), d=-self.d, e=-self.e)


def forward(polynomial: tuple[float, ...], rho: Floats) -> Floats:
    """f(rho), with the sign that makes it point forward at the centre."""
    return np.asarray(np.sign(polynomial[0]) * np.polyval(polynomial[::-1], rho))


@lru_cache(maxsize=8)
def _angles(polynomial: tuple[float, ...], farthest_px: float) -> tuple[Floats, Floats]:
    """Radii and their angles to the axis, as far as the angles grow."""
    radii = np.linspace(0, farthest_px, 4096)
    angles = np.arctan2(radii, forward(polynomial, radii))
    turns = np.flatnonzero(np.diff(angles) <= 0)
    end = len(radii) if len(turns) == 0 else turns[0] + 1
    return radii[:end], angles[:end]


class Calibration(NamedTuple):
    """What the file says: rows before columns, pixels from 0."""

    polynomial: tuple[float, ...]
    center: tuple[float, float]
    affine: tuple[float, float, float]
    size: tuple[int, int]


def read_calibration(path: Path) -> Calibration:
    """The calibration in a file; DataError that names the line that is missing or wrong."""
    lines = _lines(path)
    count, *polynomial = _numbers(lines, "direct", path)
    if count != len(polynomial) or not 0 < count <= MOST_COEFFICIENTS:
        raise _wrong(path, "direct", lines["direct"])
    row, column = _numbers(lines, "center", path, 2)
    c, d, e = _numbers(lines, "affine", path, 3)
    height, width = _numbers(lines, "image size", path, 2)
    if not (height.is_integer() and width.is_integer()):
        raise _wrong(path, "image size", lines["image size"])
    return Calibration(tuple(polynomial), (row, column), (c, d, e), (int(height), int(width)))


def _lines(path: Path) -> dict[str, str]:
    """The first line of numbers below the comment that holds each word of `WHAT`."""
    lines: dict[str, str] = {}
    word = None
    for line in filter(None, map(str.strip, _text(path).splitlines())):
        if line.startswith("#"):
            word = next((word for word in WHAT if word in line.lower()), None)
        elif word is not None:
            lines.setdefault(word, line)
    return lines


def _text(path: Path) -> str:
    try:
        data = content_of(path, LARGEST_FILE)
    except OSError as error:
        raise DataError(f"{path} cannot be read ({error.strerror}); give a calib_results.txt") from error
    return data.decode("utf-8", errors="replace")


def _numbers(lines: dict[str, str], word: str, path: Path, count: int | None = None) -> list[float]:
    if word not in lines:
        raise DataError(f"{path} lacks {WHAT[word]}; a calib_results.txt has them below a comment with {word!r}")
    try:
        numbers = [float(text) for text in lines[word].split()]
    except ValueError as error:
        raise _wrong(path, word, lines[word]) from error
    if not all(map(math.isfinite, numbers)) or (count is not None and len(numbers) != count):
        raise _wrong(path, word, lines[word])
    return numbers


def _wrong(path: Path, word: str, line: str) -> DataError:
    return DataError(
        f"{path} should hold {WHAT[word]} below the comment with {word!r}, but has {line[:60]!r}; export it again"
    )
