"""Detection of the circle in which an omnidirectional image shows the world."""

from __future__ import annotations

import numpy as np

from omnilab.api import Bools, Bytes, Circle, Floats, Ints
from omnilab.errors import DataError

DARK = 0.3  # a surround brighter than this share of the brightest pixels is part of the picture
LIT = 0.15  # between surround and brightest pixels: above it, a pixel shows the world
NEAR_PX = 1.5  # from the circle, for a point of the rim to be on it
FILLED = 0.8  # least share of the disc that the lit region's hull covers
LIKE = 0.6  # of the area of the largest lit region, from which on another beside it is a circle of its own
TRIALS = 500


def find_circle(images: Bytes) -> Circle:
    """The image circle of images (N, H, W) of one camera.

    A dark surround (its level is that of the corners) is separated from the pixels that are lit in any of the images. The
    circle goes through the corners of the lit region's convex hull: dark objects at the rim only cut chords off it.
    Those on the frame's edge do not count, the rest are fitted by RANSAC (Fischler and Bolles, 1981) and least squares.
    A dark disc around the centre becomes the inner radius. Without a dark surround it is the circle inscribed in the
    frame. DataError if there is a dark surround and no circle, or two.
    """
    import cv2

    brightest = cv2.medianBlur(images.max(axis=0), 5)
    height, width = brightest.shape
    surround, bright = _corner_level(brightest), float(np.percentile(brightest, 99))
    if surround >= DARK * bright:
        return inscribed((height, width))
    lit = brightest > surround + LIT * (bright - surround)
    hull = _hull(lit)
    cx, cy, radius = _fit_robust(_off_frame(hull, lit.shape))
    _check_alone(lit, cx, cy, radius)
    v, u = np.indices(lit.shape)
    distance = np.hypot(u - cx, v - cy)
    if _overlap(hull, distance <= radius) < FILLED:
        raise _no_circle()
    return Circle(cx, cy, radius, _dark_radius(lit, distance))


def inscribed(shape: tuple[int, ...]) -> Circle:
    """The circle inscribed in a frame (H, W)."""
    height, width = shape
    return Circle((width - 1) / 2, (height - 1) / 2, min(width, height) / 2)


def _corner_level(image: Bytes) -> float:
    """Median of the four corners, each a twentieth of the frame wide and high."""
    h, w = (max(side // 20, 1) for side in image.shape)
    return float(np.median([image[:h, :w], image[:h, -w:], image[-h:, :w], image[-h:, -w:]]))


def _hull(lit: Bools) -> Ints:
    """Corners (M, 2) = (u, v) of the convex hull of the largest lit region."""
    import cv2

    _, labels, stats, _ = cv2.connectedComponentsWithStats(lit.astype(np.uint8))
    largest = 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())
    points = cv2.findNonZero((labels == largest).astype(np.uint8)).reshape(-1, 2)
    return np.asarray(cv2.convexHull(points).reshape(-1, 2))


def _check_alone(lit: Bools, cx: float, cy: float, radius: float) -> None:
    """DataError if a second region as large lies beside the circle, as of two fisheyes back to back."""
    import cv2

    _, _, stats, centers = cv2.connectedComponentsWithStats(lit.astype(np.uint8))
    areas = stats[1:, cv2.CC_STAT_AREA]
    beside = np.hypot(*(centers[1:] - [cx, cy]).T) > radius
    if (beside & (areas > LIKE * areas.max())).any():
        raise DataError(
            "the pictures show two circles, as 360-degree cameras take them before they are stitched; give"
            " sensor.panorama=dual_fisheye, or sensor.circle_px=[cx,cy,radius] of one"
        )


def _off_frame(points: Ints, shape: tuple[int, ...]) -> Floats:
    inside = (points > 2) & (points < np.array(shape[::-1]) - 3)
    return points[inside.all(-1)].astype(float)


def _overlap(hull: Ints, disc: Bools) -> float:
    """Area that the hull and the disc (H, W) share, over that of both together."""
    import cv2

    region = cv2.fillConvexPoly(np.zeros(disc.shape, np.uint8), hull, 1) > 0
    return float((region & disc).sum() / (region | disc).sum())


def _fit_robust(points: Floats) -> tuple[float, float, float]:
    """Centre and radius of the circle through most of the points (M, 2)."""
    if len(points) < 3:
        raise _no_circle()
    triples = np.random.default_rng(0).integers(len(points), size=(TRIALS, 3))
    near = max((_near(points, *_through(points[triple])) for triple in triples), key=np.count_nonzero)
    return _through(points[near])


def _through(points: Floats) -> tuple[float, float, float]:
    """The circle u^2 + v^2 = 2 cx u + 2 cy v + c that fits points (M, 2) best (Kasa, 1976)."""
    A = np.column_stack([2 * points, np.ones(len(points))])
    cx, cy, c = np.linalg.lstsq(A, (points**2).sum(-1), rcond=None)[0]
    return float(cx), float(cy), float(np.sqrt(max(c + cx**2 + cy**2, 0.0)))


def _near(points: Floats, cx: float, cy: float, radius: float) -> Bools:
    return np.asarray(np.abs(np.hypot(points[:, 0] - cx, points[:, 1] - cy) - radius) < NEAR_PX)


def _dark_radius(lit: Bools, distance: Floats) -> float:
    """Up to which distance from the centre most pixels are dark; 0 if the centre is lit."""
    ring = np.rint(distance).astype(int).ravel()
    share = np.bincount(ring, lit.ravel()) / np.maximum(np.bincount(ring), 1)
    return float(np.argmax(share > 0.5))


def _no_circle() -> DataError:
    return DataError(
        "no image circle stands out from the dark surround; give sensor.circle_px=[cx,cy,radius] or [cx,cy,radius,inner]"
    )
