"""Canvas that textures are painted on, with noise, cells and blending."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from omnilab.api import Floats, Ints


@dataclass(frozen=True)
class Cells:
    """A canvas parted into cells: which one each texel is in (H, W), and metres (H, W) from that one's lower left corner."""

    row: Ints
    column: Ints
    x: Floats
    y: Floats
    rng: np.random.Generator

    def numbers(self, low: float, high: float) -> Floats:
        """A random number for each cell, as (H, W)."""
        return self.rng.uniform(low, high, (self.row.max() + 1, self.column.max() + 1))[self.row, self.column]

    def choice(self, count: int) -> Ints:
        """A random index below `count` for each cell, as (H, W)."""
        return self.rng.integers(count, size=(self.row.max() + 1, self.column.max() + 1))[self.row, self.column]

    def joints(self, width_m: float) -> Floats:
        """1 in the joints (H, W) to the left of the cells and below them, else 0."""
        return ((self.x < width_m) | (self.y < width_m)).astype(np.float64)


@dataclass(frozen=True)
class Canvas:
    """The surface to paint: a quad of `size_m`, with (H, W) texels, whose row 0 is its lower edge."""

    size_m: tuple[float, float]
    shape: tuple[int, int]
    rng: np.random.Generator

    @property
    def xy(self) -> tuple[Floats, Floats]:
        """Metres (1, W) and (H, 1) of the texels from the lower left corner."""
        (width, height), (h, w) = self.size_m, self.shape
        return (np.arange(w)[None] + 0.5) * (width / w), (np.arange(h)[:, None] + 0.5) * (height / h)

    def noise(self, cell_x_m: float, cell_y_m: float) -> Floats:
        """Smooth noise (H, W) in [-1, 1] with features about as large as the cell."""
        columns, rows = (
            max(2, round(size / cell)) for size, cell in zip(self.size_m, (cell_x_m, cell_y_m), strict=True)
        )
        coarse = self.rng.uniform(-1, 1, (min(rows, self.shape[0]), min(columns, self.shape[1]))).astype(np.float32)
        return np.asarray(cv2.resize(coarse, self.shape[::-1], interpolation=cv2.INTER_CUBIC).clip(-1, 1))

    def rough(self, cell_m: float) -> Floats:
        """Noise (H, W) in [-1, 1] of three octaves from `cell_m` down."""
        return (4 * self.noise(cell_m, cell_m) + 2 * self.noise(cell_m / 3, cell_m / 3) + self.noise(0.02, 0.02)) / 7

    def cells(self, width_m: float, height_m: float, shifts_m: Any = (0.0,)) -> Cells:
        """Rows of cells; row r begins `shifts_m[r % len(shifts_m)]` to the left of the canvas."""
        x, y = self.xy
        # cells below a texel would not show, but cost memory
        width_m, height_m = max(width_m, self.size_m[0] / self.shape[1]), max(height_m, self.size_m[1] / self.shape[0])
        row = np.floor(y / height_m).astype(int)
        x = x + np.asarray(shifts_m)[row % len(shifts_m)]
        column = np.floor(x / width_m).astype(int)
        return Cells(row, column, x - column * width_m, np.broadcast_to(y - row * height_m, x.shape), self.rng)

    def filled(self, color: list[float]) -> Floats:
        """A picture (H, W, 3) of one colour."""
        return np.full((*self.shape, 3), color, np.float32)


Painter = Callable[[Canvas], Floats]  # returns (H, W, 3), RGB from 0 to 255


@dataclass(frozen=True)
class Paint:
    """What covers a quad. A glowing one takes no light from the lamps."""

    painter: Painter
    glows: bool = False


@dataclass
class Sheet:
    """A paint on a wall of `size_m`, of which quads show parts: painted once, so that the pattern runs through."""

    paint: Paint
    size_m: tuple[float, float]
    _whole: Floats | None = None

    def part(self, x_m: float, y_m: float) -> Paint:
        """What a quad shows whose lower left corner lies there on the wall."""

        def paint(canvas: Canvas) -> Floats:
            (h, w), (width, height) = canvas.shape, canvas.size_m
            whole = self._painted((h / height, w / width), canvas.rng)
            x, y = canvas.xy
            rows = (y + y_m) * (whole.shape[0] / self.size_m[1])
            columns = (x + x_m) * (whole.shape[1] / self.size_m[0])
            return np.asarray(whole[rows.astype(int), columns.astype(int)])

        return Paint(paint, self.paint.glows)

    def _painted(self, density: tuple[float, float], rng: np.random.Generator) -> Floats:
        if self._whole is None:
            shape = (max(2, round(self.size_m[1] * density[0])), max(2, round(self.size_m[0] * density[1])))
            self._whole = np.asarray(self.paint.painter(Canvas(self.size_m, shape, rng)), np.float32)
        return self._whole


def framed(picture: Floats, canvas: Canvas, border_m: float, color: Any) -> Floats:
    """The picture (H, W, 3) with a border in one colour."""
    x, y = canvas.xy
    width, height = canvas.size_m
    inside = (np.minimum(x, width - x) > border_m) & (np.minimum(y, height - y) > border_m)
    return mixed(inside, picture, color)


def toned(color: Any, tone: Floats) -> Floats:
    """A colour (3,), or a picture (H, W, 3), made brighter or darker by factors (H, W)."""
    return np.asarray(np.asarray(color) * tone[..., None])


def mixed(share: Any, one: Any, other: Any) -> Floats:
    """Of two colours or pictures, `share` (H, W) of the one and the rest of the other."""
    return np.asarray(other + share[..., None] * np.subtract(one, other))
