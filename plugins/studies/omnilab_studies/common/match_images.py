"""Pictures of matches between images: how far each moved on a panorama, and two panoramas with lines between."""

from __future__ import annotations

import numpy as np

from omnilab.api import Bytes, Floats, Frames, Motion
from omnilab.image import PANORAMA_SHAPE, panorama, to_color

ZOOM = 2
INLIER, OUTLIER = (70, 220, 130), (240, 80, 80)


def draw_matches(frame: Frames, motion: Motion | None) -> Bytes:
    """The panorama of an image (a batch of one) with its matches, clockwise to the right, as a person sees it.

    Lines lead from where a match would be under the motion's rotation alone to where it is: green of inliers, red of
    outliers. The half of the panorama that won a half-window vote is bright.
    """
    import cv2

    rows, columns = PANORAMA_SHAPE
    picture = to_color(panorama(frame.images, frame.camera, (ZOOM * rows, ZOOM * columns)))[0]
    if motion is not None and motion.window_rad is not None:
        azimuth = 2 * np.pi * np.arange(ZOOM * columns) / (ZOOM * columns)
        outside = np.mod(azimuth - motion.window_rad, 2 * np.pi) >= np.pi
        picture[:, outside] //= 2
    picture = np.asarray(cv2.flip(picture, 1), np.uint8)
    if motion is not None and motion.matches is not None:
        _draw_displacements(picture, motion, motion.matches)
    return picture


def _draw_displacements(picture: Bytes, motion: Motion, matches: Floats) -> None:
    """Lines and dots of matches (M, 2, 2) into a flipped panorama."""
    import cv2

    rotation = 0.0 if np.isnan(motion.vector[2]) else float(motion.vector[2])
    start = _pixels(matches[:, 0] - [rotation, 0.0], picture.shape)
    end = _pixels(matches[:, 1], picture.shape)
    agree = np.ones(len(end), bool) if motion.agree is None else motion.agree
    near = np.abs(end[:, 0] - start[:, 0]) < picture.shape[1] / 2  # not across the seam
    ends = np.rint(np.column_stack([start, end])).astype(int).tolist()
    for (u0, v0, u, v), inlier, whole in zip(ends, agree.tolist(), near.tolist(), strict=True):
        color = INLIER if inlier else OUTLIER
        if whole:
            cv2.line(picture, (u0, v0), (u, v), color, 1, cv2.LINE_AA)
        cv2.circle(picture, (u, v), 2, color, -1, cv2.LINE_AA)


def _pixels(azimuth_level: Floats, shape: tuple[int, ...]) -> Floats:
    """Pixels (M, 2) of azimuths and levels (M, 2) in the panorama, flipped as it is shown."""
    share = np.mod(azimuth_level[:, 0], 2 * np.pi) / (2 * np.pi)
    return np.column_stack([shape[1] - 1 - share * shape[1], (1 - azimuth_level[:, 1]) * shape[0] - 0.5])


def draw_image_pair(now: Bytes, view: Bytes | None, motion: Motion | None) -> Bytes:
    """A panorama (H, W) above that of a view, with lines between the inliers; black where no view is compared.

    Panoramas are as `omnilab.image.panorama` makes them; they are shown clockwise, inliers in green.
    """
    import cv2

    below = np.zeros_like(now) if view is None else view
    both = [np.repeat(np.repeat(picture, ZOOM, axis=0), ZOOM, axis=1)[:, ::-1] for picture in (now, below)]
    picture = np.ascontiguousarray(to_color(np.vstack(both)[None])[0] if now.ndim == 2 else np.vstack(both))
    if motion is None or motion.matches is None or motion.agree is None:
        return picture
    half = (len(both[0]), picture.shape[1])
    ends = [_pixels(motion.matches[:, k], half) + np.array([0, k * half[0]]) for k in (0, 1)]
    for (u0, v0), (u1, v1), inlier in zip(ends[0].tolist(), ends[1].tolist(), motion.agree.tolist(), strict=True):
        for u, v in ((u0, v0), (u1, v1)):
            cv2.circle(picture, (round(u), round(v)), 2, INLIER if inlier else OUTLIER, -1, cv2.LINE_AA)
        if inlier:
            cv2.line(picture, (round(u0), round(v0)), (round(u1), round(v1)), INLIER, 1, cv2.LINE_AA)
    return picture
