"""Matches of an odometry drawn into panoramas."""

from __future__ import annotations

import numpy as np

from omnilab.api import Bytes, Floats, Frames, Motion
from omnilab.image import PANORAMA_SHAPE, panorama, to_color

ZOOM = 2
AGREES, DISAGREES = (70, 220, 130), (240, 80, 80)


def draw_matches(frame: Frames, motion: Motion | None) -> Bytes:
    """The panorama of an image (a batch of one), clockwise to the right, as a person sees it.

    A line leads from where a match would be after the estimated rotation alone to where it is: green where it agrees
    with the motion, else red. The half of the panorama with the most votes is bright.
    """
    import cv2

    rows, columns = PANORAMA_SHAPE
    picture = panorama(to_color(frame.images), frame.camera, (ZOOM * rows, ZOOM * columns))[0]
    if motion is not None and motion.window_rad is not None:
        azimuth = 2 * np.pi * np.arange(ZOOM * columns) / (ZOOM * columns)
        outside = np.mod(azimuth - motion.window_rad, 2 * np.pi) >= np.pi
        picture[:, outside] //= 2
    picture = np.ascontiguousarray(picture[:, ::-1])
    if motion is None or motion.matches is None:
        return picture
    rotation = 0.0 if np.isnan(motion.vector[2]) else float(motion.vector[2])
    start = _pixels(motion.matches[:, 0] - [rotation, 0.0], picture.shape)
    end = _pixels(motion.matches[:, 1], picture.shape)
    agree = np.ones(len(end), bool) if motion.agree is None else motion.agree
    for (u0, v0), (u, v), good in zip(start.tolist(), end.tolist(), agree.tolist(), strict=True):
        color = AGREES if good else DISAGREES
        if abs(u - u0) < picture.shape[1] / 2:  # not across the seam
            cv2.line(picture, (round(u0), round(v0)), (round(u), round(v)), color, 1, cv2.LINE_AA)
        cv2.circle(picture, (round(u), round(v)), 2, color, -1, cv2.LINE_AA)
    return picture


def _pixels(azimuth_level: Floats, shape: tuple[int, ...]) -> Floats:
    """Pixels (M, 2) of azimuths and levels (M, 2) in the panorama, flipped as it is shown."""
    share = np.mod(azimuth_level[:, 0], 2 * np.pi) / (2 * np.pi)
    return np.column_stack([shape[1] - 1 - share * shape[1], (1 - azimuth_level[:, 1]) * shape[0] - 0.5])


def draw_match_pair(now: Bytes, view: Bytes | None, motion: Motion | None) -> Bytes:
    """A panorama (H, W) above that of a view, and lines between their matches; black where no view is compared.

    Panoramas are as `omnilab.image.panorama` makes them; they are shown clockwise, matches that agree in green.
    """
    import cv2

    below = np.zeros_like(now) if view is None else view
    both = [np.repeat(np.repeat(picture, ZOOM, axis=0), ZOOM, axis=1)[:, ::-1] for picture in (now, below)]
    picture = np.ascontiguousarray(to_color(np.vstack(both)[None])[0] if now.ndim == 2 else np.vstack(both))
    if motion is None or motion.matches is None or motion.agree is None:
        return picture
    half = (len(both[0]), picture.shape[1])
    ends = [_pixels(motion.matches[:, k], half) + np.array([0, k * half[0]]) for k in (0, 1)]
    for (u0, v0), (u1, v1), good in zip(ends[0].tolist(), ends[1].tolist(), motion.agree.tolist(), strict=True):
        for u, v in ((u0, v0), (u1, v1)):
            cv2.circle(picture, (round(u), round(v)), 2, AGREES if good else DISAGREES, -1, cv2.LINE_AA)
        if good:
            cv2.line(picture, (round(u0), round(v0)), (round(u1), round(v1)), AGREES, 1, cv2.LINE_AA)
    return picture
