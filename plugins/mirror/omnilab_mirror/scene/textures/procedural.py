"""Procedural textures. A new one is a function here, from its settings to a painter, and a line in `TEXTURES`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from omnilab.api import Bytes, Floats
from omnilab_mirror.scene.textures.canvas import Canvas, Paint, Painter, framed, mixed, toned
from omnilab_mirror.scene.textures.images import image
from omnilab_mirror.scene.textures.outdoors import facade, sky
from omnilab_mirror.scene.world_yaml import Section

HANDLE = (225, 200, 90)
NIGHT = np.array([0.1, 0.12, 0.2])  # what it leaves of red, green and blue
ZENITH, HORIZON, HILLS, TREES = (120, 175, 245), (150, 190, 235), (110, 140, 95), (50, 85, 45)


def plain(s: Section) -> Painter:
    """One colour."""
    color = s.color("color")
    return lambda canvas: canvas.filled(color)


def noise(s: Section) -> Painter:
    """A colour that varies: plaster, carpet, cloth, foliage."""
    color, amount, grain = s.color("color"), s.number("amount", 0.2, 0, 1), s.number("grain_m", 0.3, 0.001, 100)
    return lambda canvas: toned(color, 1 + amount * canvas.rough(grain))


def wood(s: Section) -> Painter:
    """Boards of (length, width), in rows that are shifted, each with its tone and grain along it."""
    color, (length, width) = s.color("color"), s.size("board_m", 2, [1.2, 0.12])
    contrast = s.number("contrast", 0.25, 0, 1)

    def paint(canvas: Canvas) -> Floats:
        boards = canvas.cells(length, width, canvas.rng.uniform(0, length, 100))
        grain = 0.6 * canvas.noise(0.5, 0.015) + 0.4 * canvas.noise(1.5, 0.06)
        tone = 1 + contrast * (0.7 * boards.numbers(-1, 1) + 0.5 * grain)
        return toned(color, tone * (1 - 0.6 * boards.joints(0.004)))

    return paint


def bricks(s: Section) -> Painter:
    """Courses of bricks of (length, height), each shifted by a half, with mortar between them."""
    color, mortar = s.color("color"), s.color("mortar", [190, 185, 175])
    (length, height), joint = s.size("brick_m", 2, [0.25, 0.085]), s.number("joint_m", 0.012, 0, 1)

    def paint(canvas: Canvas) -> Floats:
        courses = canvas.cells(length, height, [0, length / 2])
        brick = toned(color, 1 + 0.28 * courses.numbers(-1, 1) + 0.15 * canvas.rough(0.1))
        return mixed(courses.joints(joint), mortar, brick)

    return paint


def tiles(s: Section) -> Painter:
    """Square tiles in one or more colours, drawn at random or in order, with joints."""
    colors, side = np.asarray(s.colors("colors")), s.number("side_m", 0.2, 0.001, 100)
    joint, ordered = s.number("joint_m", 0.006, 0, 1), s.flag("ordered", False)

    def paint(canvas: Canvas) -> Floats:
        cells = canvas.cells(side, side)
        index = (cells.row + cells.column) % len(colors) if ordered else cells.choice(len(colors))
        return toned(colors[index], (1 + 0.08 * canvas.rough(0.15)) * (1 - 0.45 * cells.joints(joint)))

    return paint


def stripes(s: Section) -> Painter:
    """Upright stripes, or level ones, each of `width_m` on the average."""
    colors, width = np.asarray(s.colors("colors")), s.number("width_m", 0.1, 0.001, 100)
    level, regular = s.flag("level", False), s.flag("regular", True)

    def paint(canvas: Canvas) -> Floats:
        across = canvas.xy[1 if level else 0]
        edges = np.arange(0, across.max() + 2 * width, width)
        if not regular:
            edges = edges + canvas.rng.uniform(-0.4, 0.4, len(edges)) * width
        band = np.broadcast_to(np.searchsorted(edges, across) % len(colors), canvas.shape)
        return toned(colors[band], 1 + 0.06 * canvas.rough(0.2))

    return paint


def motifs(s: Section) -> Painter:
    """Wallpaper: a diamond or a dot in each cell of a shifted grid, over a ground with soft stripes."""
    ground, colors = s.color("ground"), np.asarray(s.colors("colors"))
    cell, dots = s.number("cell_m", 0.3, 0.001, 100), s.flag("dots", False)

    def paint(canvas: Canvas) -> Floats:
        cells = canvas.cells(cell, cell, [0, cell / 2])
        dx, dy = np.abs(cells.x / cell - 0.5), np.abs(cells.y / cell - 0.5)
        inside = np.hypot(dx, dy) < 0.3 if dots else dx + dy < 0.4
        stripe = 1 + 0.07 * np.sign(np.sin(2 * np.pi * canvas.xy[0] / cell))
        return mixed(inside, colors[cells.choice(len(colors))], toned(ground, stripe * (1 + 0.05 * canvas.rough(0.3))))

    return paint


def poster(s: Section) -> Painter:
    """Random shapes on a ground with a white margin."""
    ground, count, seed = s.color("ground"), int(s.number("shapes", 12, 0, 1000)), int(s.number("seed", 0, 0, 1e9))

    def paint(canvas: Canvas) -> Floats:
        # its own seed: the same poster twice in a world is the same picture
        rng, picture = np.random.default_rng(seed), canvas.filled(ground)
        h, w = canvas.shape
        for _ in range(count):
            color = rng.uniform(0, 255, 3).tolist()
            center = (int(rng.uniform(0, w)), int(rng.uniform(0, h)))
            a, b = (rng.uniform(0.05, 0.35, 2) * min(h, w)).astype(int).tolist()
            turn = float(rng.uniform(0, 180))
            if rng.random() < 0.5:
                cv2.ellipse(picture, center, (a, b), turn, 0, 360, color, -1)
            else:
                corners = cv2.boxPoints((center, (2.0 * a, 2.0 * b), turn)).astype(np.int32)
                cv2.fillPoly(picture, [corners], color)
        return framed(picture, canvas, 0.03, [240, 238, 230])

    return paint


def door(s: Section) -> Painter:
    """A door: two panels, a handle and a frame."""
    color = s.color("color")

    def paint(canvas: Canvas) -> Floats:
        x, y = canvas.xy
        width, height = canvas.size_m
        picture = toned(color, 1 + 0.15 * canvas.noise(0.02, 0.6))
        for low, high in ((0.08, 0.42), (0.5, 0.92)):
            edge = np.maximum(np.abs(x / width - 0.5) - 0.3, np.abs(y / height - (low + high) / 2) - (high - low) / 2)
            picture = toned(picture, np.where(np.abs(edge) < 0.02, 0.5, 1.0))
        picture = mixed(np.hypot(x - 0.88 * width, y - 0.47 * height) < 0.04, HANDLE, picture)
        return framed(picture, canvas, 0.05, toned(color, np.array(0.6)))

    return paint


def window(s: Section) -> Painter:
    """A view of sky, hills and trees, by day or by `night`, behind a frame with crossbars."""
    frame, seed = s.color("frame", [235, 235, 230]), int(s.number("seed", 0, 0, 1e9))
    night = s.flag("night", False)

    def paint(canvas: Canvas) -> Floats:
        x, y = canvas.xy
        width, height = canvas.size_m
        phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, 3)
        hills = height * (0.36 + 0.08 * np.sin(2.1 * x + phase[0]) + 0.05 * np.sin(5.3 * x + phase[1]))
        trees = height * (0.16 + 0.05 * np.sin(3.7 * x + phase[2])) + 0.08 * canvas.noise(0.08, 0.08)
        sky = mixed(y / height + 0.15 * canvas.rough(0.5), ZENITH, HORIZON)
        landscape = mixed(y < trees, TREES, mixed(y < hills, HILLS, sky))
        landscape = landscape * (NIGHT if night else 1)
        bars = (np.abs(x - width / 2) < 0.025) | (np.abs(y - height * 0.62) < 0.02)
        return framed(mixed(bars, frame, landscape), canvas, 0.06, frame)

    return paint


def books(s: Section) -> Painter:
    """Shelves of books of all colours, some of them missing."""
    shelf, color = s.number("shelf_m", 0.34, 0.05, 100), s.color("color", [110, 75, 45])

    def paint(canvas: Canvas) -> Floats:
        x, y = canvas.xy
        picture = canvas.filled(color) * 0.35
        for bottom in np.arange(0, canvas.size_m[1], shelf):
            edges = np.cumsum(canvas.rng.uniform(0.02, 0.07, int(canvas.size_m[0] / 0.02) + 1))
            book = np.searchsorted(edges, x[0])
            spines = canvas.rng.uniform(30, 230, (len(edges) + 1, 3))[book]
            heights = (
                shelf
                * np.where(canvas.rng.random(len(edges) + 1) < 0.12, 0, canvas.rng.uniform(0.5, 0.88, len(edges) + 1))[
                    book
                ]
            )
            picture = mixed((y >= bottom) & (y - bottom < heights), spines, picture)
        return framed(mixed(canvas.cells(100, shelf).y < 0.03, color, picture), canvas, 0.03, color)

    return paint


TEXTURES: dict[str, Callable[[Section], Painter]] = {
    "books": books,
    "bricks": bricks,
    "door": door,
    "facade": facade,
    "image": image,
    "motifs": motifs,
    "noise": noise,
    "plain": plain,
    "poster": poster,
    "sky": sky,
    "stripes": stripes,
    "tiles": tiles,
    "window": window,
    "wood": wood,
}


SKIES = ("image", "plain", "sky")
SKY_SHAPE = (540, 1080)


def sky_of(s: Section, textures: dict[str, Section]) -> Bytes:
    """The sky (h, w, 3) that the key `sky` names: row 0 overhead, column 0 to +x, counter-clockwise.

    An image is an equirectangular photograph, up to down from zenith to nadir; its left and right edge lie at +x.
    """
    texture = textures[s.choice("sky", textures)]
    kind = texture.value("kind")
    if kind not in SKIES or "tile_m" in texture:
        raise s.invalid(
            "sky", s.value("sky"), f"a texture that closes around the sphere: of kind {', '.join(SKIES)}, not tiled"
        )
    canvas = Canvas((2 * np.pi, np.pi), SKY_SHAPE, np.random.default_rng(0))
    painted = paint(texture).painter(canvas)
    return np.asarray(np.clip(np.rint(painted), 0, 255), np.uint8)[::-1, ::-1]


def paint(s: Section) -> Paint:
    """The paint that a section of `textures` describes."""
    result = TEXTURES[s.choice("kind", TEXTURES)](s)
    glows = s.flag("glows", False)
    s.done()
    return Paint(result, glows)


def paint_of(s: Section, key: str, textures: dict[str, Paint], default: Any = (200, 200, 200)) -> Paint:
    """The paint that a key names: a texture of the file, or a colour [red, green, blue]."""
    if not isinstance(s.value(key, list(default)), list):
        return textures[s.choice(key, textures)]
    color = s.color(key, list(default))
    return Paint(lambda canvas: canvas.filled(color))
