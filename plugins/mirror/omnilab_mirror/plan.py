"""Plan view of a world, with its dimensions in millimetres (Berenguer, thesis, figures 3.9, 4.11a and 5.9)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from omnilab.api import Bytes, Floats
from omnilab.errors import ConfigError
from omnilab_mirror.render.free_space import obstacles
from omnilab_mirror.render.viewer_mesh import mesh_of

if TYPE_CHECKING:
    from omnilab_mirror.scene.world import World

MARGIN_PX = 110  # around the world, for its dimensions
LONG_PX, MOST_PX = 1000, 10_000  # of the longer side: by default, and at most
CUT_M = 2.0  # what begins higher is left out, as in a plan of a building
DARK, MAP, PATH, PLACE = (40, 40, 40), (37, 99, 168), (42, 157, 92), (209, 64, 63)


@dataclass(frozen=True)
class FloorPlan:
    """A picture from above: x to the right, y up, `px_per_m` pixels a metre around the rectangle `low`, `high` (2,)."""

    low: Floats
    high: Floats
    px_per_m: float

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        width, height = np.ceil((self.high - self.low) * self.px_per_m).astype(int) + 2 * MARGIN_PX
        return int(height), int(width)

    def pixels(self, points: Floats) -> Floats:
        """Pixels (N, 2), column and row, of points (N, 2) or (N, 3)."""
        x, y = ((points[:, :2] - self.low) * self.px_per_m + MARGIN_PX).T
        return np.column_stack([x, self.shape[0] - y])


def plan_of(world: World, px_per_m: float | None = None, step_m: float | None = None, height_m: float = 1.0) -> Bytes:
    """The plan (H, W, 3), RGB: what stands below 2 m from above, rooms and map with their lengths, and the paths.

    Without `px_per_m` its longer side has 1000 pixels between the margins. With `step_m`, a dot at each free place of the
    map's grid, as studies have them, at `height_m`.
    """
    low, high = _extent(world)
    longer_m = float((high - low).max())
    plan = FloorPlan(low, high, LONG_PX / longer_m if px_per_m is None else px_per_m)
    if max(plan.shape) > MOST_PX:
        raise ConfigError(
            f"{plan.px_per_m:g} pixels a metre make a plan of {plan.shape[1]} x {plan.shape[0]}; give at most"
            f" {(MOST_PX - 2 * MARGIN_PX) / longer_m:.3g}"
        )
    picture = np.full((*plan.shape, 3), 255, np.uint8)
    _draw_things(picture, plan, world)
    for area in world.areas:
        _rectangle(picture, plan, area.low[:2], area.high[:2], DARK, 5 if area.walled else 1)
    for route in world.paths.values():
        line = np.round(plan.pixels(route.corners)).astype(np.int32)
        cv2.polylines(picture, [line], False, PATH, 3, cv2.LINE_AA)
    half = np.array(world.map_m) / 2
    _rectangle(picture, plan, -half, half, MAP, 2)
    if step_m is not None:
        for column, row in plan.pixels(_free_places(world, step_m, height_m)):
            cv2.circle(picture, (round(column), round(row)), 3, PLACE, -1, cv2.LINE_AA)
    return _with_dimensions(picture, plan, world)


def _extent(world: World) -> tuple[Floats, Floats]:
    """The lowest and the highest corner (2,) of all rooms, of the map and, without rooms, of what stands there."""
    half = np.array(world.map_m) / 2
    corners = [-half, half, *(corner[:2] for area in world.areas for corner in (area.low, area.high))]
    if not world.areas:
        corners += list(mesh_of(world).vertices_m[:, :2])
    return np.min(corners, axis=0), np.max(corners, axis=0)


def _draw_things(picture: Bytes, plan: FloorPlan, world: World) -> None:
    """Triangles from above, the lowest first, each in its mean colour."""
    mesh = mesh_of(world)
    corners = mesh.vertices_m[mesh.triangles]  # (T, 3, 3)
    shown = corners[:, :, 2].min(axis=1) < CUT_M
    order = np.flatnonzero(shown)[np.argsort(corners[shown][:, :, 2].max(axis=1), kind="stable")]
    pixels = np.round(plan.pixels(corners.reshape(-1, 3))).astype(np.int32).reshape(-1, 3, 2)
    colors = mesh.colors[mesh.triangles].mean(axis=1)
    for i in order:
        cv2.fillConvexPoly(picture, pixels[i], colors[i].tolist(), cv2.LINE_AA)


def _rectangle(picture: Bytes, plan: FloorPlan, low: Floats, high: Floats, color: tuple[int, ...], width: int) -> None:
    (left, bottom), (right, top) = np.round(plan.pixels(np.array([low, high]))).astype(int)
    cv2.rectangle(picture, (int(left), int(top)), (int(right), int(bottom)), color, width)


def _free_places(world: World, step_m: float, height_m: float) -> Floats:
    """Nodes (N, 3) of the grid around the origin that a robot with its camera at that height may take."""
    x, y = (
        step_m * np.arange(-int(side / 2 / step_m + 1e-9), int(side / 2 / step_m + 1e-9) + 1) for side in world.map_m
    )
    nodes = np.array([(px, py, height_m) for py in y for px in x])
    return nodes[[not why for why in obstacles(world, nodes, on_floor=True)]]


def _with_dimensions(picture: Bytes, plan: FloorPlan, world: World) -> Bytes:
    """Lines with arrows and lengths: of all that is drawn outside, of the map nearer by, and the names of the rooms."""
    from PIL import Image, ImageDraw, ImageFont

    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image)
    font = ImageFont.load_default(20)
    for low, high, color, away in (
        (plan.low, plan.high, DARK, 80), (-np.array(world.map_m) / 2, np.array(world.map_m) / 2, MAP, 35),
    ):  # fmt: skip
        _dimension(image, draw, font, plan, low, high, color, away)
    if len(world.areas) > 1:
        for area in world.areas:
            at = tuple(plan.pixels((area.low + area.high)[None] / 2)[0])
            x, y = 1000 * (area.high - area.low)[:2]
            text = f"{area.name}\n{x:.0f} x {y:.0f}"
            draw.multiline_text(at, text, DARK, font, "mm", align="center", stroke_width=3, stroke_fill="white")
    draw.text((MARGIN_PX, 12), "Dimensions in millimetres; blue: the map; green: paths", DARK, font)
    return np.asarray(image)


def _dimension(
    image: Any, draw: Any, font: Any, plan: FloorPlan, low: Floats, high: Floats, color: tuple[int, ...], away: int
) -> None:
    """Length along x below the drawing and along y on its left, `away` pixels from it."""
    (left, bottom), (right, top) = plan.pixels(np.array([low, high]))
    row, column = plan.shape[0] - MARGIN_PX + away, MARGIN_PX - away
    _arrow(draw, (left, row), (right, row), color)
    _arrow(draw, (column, bottom), (column, top), color)
    x, y = 1000 * (high - low)
    _text(image, font, f"{x:.0f}", ((left + right) / 2, row), color, 0)
    _text(image, font, f"{y:.0f}", (column, (top + bottom) / 2), color, 90)


def _arrow(draw: Any, start: tuple[float, float], end: tuple[float, float], color: tuple[int, ...]) -> None:
    draw.line([start, end], color, 2)
    along = np.subtract(end, start) / np.linalg.norm(np.subtract(end, start))
    across = np.array([-along[1], along[0]])
    for tip, back in ((np.array(start), along), (np.array(end), -along)):
        head = [tip, tip + 12 * back + 4 * across, tip + 12 * back - 4 * across]
        draw.polygon([tuple(corner) for corner in head], color)


def _text(image: Any, font: Any, text: str, at: tuple[float, float], color: tuple[int, ...], turn_deg: int) -> None:
    """A text in the middle of its line, which it interrupts."""
    from PIL import Image, ImageDraw

    left, top, right, bottom = font.getbbox(text)
    label = Image.new("RGB", (int(right - left) + 12, int(bottom - top) + 6), "white")
    ImageDraw.Draw(label).text((6 - left, 3 - top), text, color, font)
    label = label.rotate(turn_deg, expand=True)
    image.paste(label, (round(at[0] - label.width / 2), round(at[1] - label.height / 2)))
