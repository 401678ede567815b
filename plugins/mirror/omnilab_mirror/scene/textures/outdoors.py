"""Textures for the outdoors: houses and the sky."""

from __future__ import annotations

import cv2
import numpy as np

from omnilab.api import Floats
from omnilab_mirror.scene.textures.canvas import Canvas, Painter, mixed, toned
from omnilab_mirror.scene.world_yaml import Section


def facade(s: Section) -> Painter:
    """A house's front: plastered or of bricks, rows of windows with frames and sills, a darker base."""
    color, (bay, storey) = s.color("color"), s.size("bay_m", 2, [2.2, 3.0])
    (width, height), frame = s.size("window_m", 2, [1.1, 1.6]), s.color("frame", [235, 232, 225])
    glass, lit = s.color("glass", [62, 76, 92]), s.number("lit", 0.0, 0, 1)
    joints = s.number("brick_m", 0.0, 0, 10)

    def paint(canvas: Canvas) -> Floats:
        count = max(1, round(canvas.size_m[0] / bay))
        cells = canvas.cells(canvas.size_m[0] / count, storey)
        x, y = np.abs(cells.x - canvas.size_m[0] / count / 2) - width / 2, cells.y - 0.3 * storey
        edge = np.maximum(x, np.abs(y - height / 2) - height / 2)
        wall = toned(color, 1 + 0.12 * canvas.rough(0.8))
        if joints:
            bricks = canvas.cells(3 * joints, joints, [0, 1.5 * joints])
            wall = toned(wall, (1 + 0.2 * bricks.numbers(-1, 1)) * (1 - 0.25 * bricks.joints(0.15 * joints)))
        wall = toned(wall, np.where(canvas.xy[1] < 0.6, 0.7, 1.0) * np.ones(canvas.shape))
        sill = (np.abs(x) < width) & (x < 0.1) & (y < 0) & (y > -0.12)
        pane = toned(glass, 0.75 + 0.5 * np.clip(y / height, 0, 1) + 0.25 * cells.numbers(-1, 1))
        pane = mixed(cells.numbers(0, 1) < lit, (255, 220, 150), pane)
        bars = (np.abs(x + width / 2) < 0.03) | (np.abs(y - 0.68 * height) < 0.03) | (edge > -0.06)
        window = mixed(bars, frame, pane)
        picture = mixed((edge < 0) & (cells.y + storey * cells.row < canvas.size_m[1] - 0.2), window, wall)
        return mixed(sill & (cells.y + storey * cells.row < canvas.size_m[1] - storey / 2), frame, picture)

    return paint


def sky(s: Section) -> Painter:
    """The sky, for the key `sky`: from `horizon` to `zenith`, clouds that cover a share of it, a sun at (azimuth, elevation)."""
    zenith, horizon = s.color("zenith", [70, 125, 205]), s.color("horizon", [200, 218, 235])
    ground, white = s.color("ground", [150, 150, 140]), s.color("cloud", [250, 250, 248])
    cover, seed = s.number("clouds", 0.45, 0, 1), int(s.number("seed", 0, 0, 1e9))
    sun = np.deg2rad(s.numbers("sun_deg", 2)) if "sun_deg" in s else None

    def paint(canvas: Canvas) -> Floats:
        x, y = canvas.xy  # as one looks up from the middle: azimuth falls to the right
        azimuth, elevation = np.broadcast_arrays(-x, y - np.pi / 2)
        up, flat = np.sin(elevation), np.cos(elevation)
        picture = mixed(np.clip(up, 0, 1) ** 0.5, zenith, horizon)
        if sun is not None:
            near = up * np.sin(sun[1]) + flat * np.cos(sun[1]) * np.cos(azimuth - sun[0])
            glow = 0.55 * np.exp((near - 1) / 0.02) + 0.25 * np.exp((near - 1) / 0.2)
            picture = mixed(np.maximum(glow, near > np.cos(0.03)), (255, 250, 235), picture)
        # clouds lie in a plane overhead, so they grow small towards the horizon
        reach = 1.5 / np.maximum(up, 0.04)
        layer = _layer(seed, reach * flat * np.cos(azimuth), reach * flat * np.sin(azimuth))
        share = np.clip((layer - 0.5 + 0.35 * (2 * cover - 1)) / 0.18, 0, 1) * np.clip((up - 0.02) / 0.15, 0, 1)
        picture = mixed(0.9 * share, toned(white, 1.02 - 0.22 * np.clip(layer - 0.45, 0, 1)), picture)
        return mixed(np.clip(-up / 0.02, 0, 1), ground, picture)

    return paint


def _layer(seed: int, x: Floats, y: Floats) -> Floats:
    """Smooth noise from 0 to 1 of five octaves at points of a plane."""
    period = 256
    tile = np.random.default_rng(seed).uniform(0, 1, (period, period)).astype(np.float32)
    total, weight = np.zeros(x.shape), 0.5
    for octave in range(5):
        column, row = (np.asarray((part * 2**octave + 37 * octave) % period, np.float32) for part in (x, y))
        total += weight * cv2.remap(tile, column, row, cv2.INTER_CUBIC, borderMode=cv2.BORDER_WRAP)
        weight /= 2
    return np.asarray(np.clip(total + weight, 0, 1))
