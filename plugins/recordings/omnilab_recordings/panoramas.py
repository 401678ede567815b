"""Pictures that are panoramas already: their cameras, and how they are told from mirror pictures."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum

import numpy as np

from omnilab.api import Circle, Floats
from omnilab.cameras import CylindricalCamera, EquirectangularCamera, RayCamera
from omnilab.cameras.dual_fisheye import side_by_side
from omnilab.errors import ConfigError, DataError
from omnilab_recordings.images.circle import inscribed
from omnilab_recordings.images.decoding import DecodedImage
from omnilab_recordings.optics import circle_of

FRONT_IN_THE_MIDDLE_DEG = 180.0  # azimuth of column 0
LEAST_WIDE, WIDE, NO_MIRROR = (
    1.2,
    1.98,
    3.0,
)  # width over height: of strips that close, of spheres, of no mirror's frame
TWO_CIRCLES = 1.8, 2.2  # width over height of two circles side by side
MOVING = 3  # images from which on what changes between them is compared
PLAIN = 0.05  # of the usual variance: columns with less are plain
CLOSES, APART = 0.65, 0.45  # of the correlation of neighbouring columns: at least and at most that of the ends
LIKE_NEIGHBOURS = 0.25  # least correlation of neighbouring columns that tells anything


class Panorama(Enum):
    """Pictures over 360 degrees as cameras and phones lay them out: the front in the middle, azimuth clockwise."""

    equirectangular = "equirectangular"  # rows evenly spaced in elevation; 2:1 is the whole sphere
    strip = "strip"  # a cylinder: verticals are straight, rows evenly spaced in height on it
    dual_fisheye = "dual_fisheye"  # not stitched yet: two circles side by side, ahead and back, of 190 degrees each


def panorama_kind(name: Panorama | str) -> Panorama:
    """The kind of panorama by its name; ConfigError, with the kinds there are, if it is none."""
    try:
        return Panorama(name)
    except ValueError:
        kinds = ", ".join(kind.value for kind in Panorama)
        raise ConfigError(f"panorama={name!r} is none that is read; give one of {kinds}, or null") from None


PLURALS = {
    Panorama.equirectangular: "equirectangular panoramas",
    Panorama.strip: "panoramic strips",
    Panorama.dual_fisheye: "pairs of fisheye pictures",
}


def declared_camera(kind: Panorama, width: int, height: int) -> RayCamera:
    """The camera of pictures of a size that are said to be of that kind; DataError if that cannot be."""
    if kind is not Panorama.dual_fisheye:
        return panorama_camera(kind, width, height)
    if not TWO_CIRCLES[0] <= width / height <= TWO_CIRCLES[1]:
        raise DataError(
            f"sensor.panorama=dual_fisheye, but {width} x {height} pixels are no two circles side by side, which are twice as"
            " wide as high; leave it out, or give a camera.json"
        )
    return side_by_side(width, height)


def panorama_camera(kind: Panorama, width: int, height: int) -> EquirectangularCamera | CylindricalCamera:
    """The camera of panoramas of a size: pixels are square at the horizon, which is the middle row.

    DataError if the frame is too high for that.
    """
    half = np.pi * height / width  # the radius of the cylinder is the unit
    if kind is Panorama.strip and height >= width:
        raise DataError(
            f"sensor.panorama=strip, but {width} x {height} pixels are no strip around 360 degrees, which is wider than high;"
            " leave it out"
        )
    if kind is Panorama.strip:
        highest = float(np.rad2deg(np.arctan(half)))
        return CylindricalCamera(width, height, FRONT_IN_THE_MIDDLE_DEG, True, -highest, highest)
    highest = 180 * height / width
    if height > width / 2 * 1.01:
        raise DataError(
            f"sensor.panorama=equirectangular, but {width} x {height} pixels are higher than half their width, and a sphere"
            " has 360 by 180 degrees; leave it out, or give a camera.json"
        )
    return EquirectangularCamera(width, height, FRONT_IN_THE_MIDDLE_DEG, True, -min(highest, 90.0), min(highest, 90.0))


def proposed(sample: Sequence[DecodedImage]) -> tuple[Panorama | None, bool]:
    """Which kind of panorama images of one size may be, by their shape, and whether they also close on themselves."""
    height, width = sample[0].shape
    if width < LEAST_WIDE * height:
        return None, False
    closed = any(image.header.equirectangular for image in sample) or closes(sample) is True
    if WIDE * height <= width <= 2.02 * height:
        return Panorama.equirectangular, closed
    if width < WIDE * height:
        return (Panorama.strip, True) if closed and len(sample) >= MOVING else (None, False)
    return (Panorama.strip, closed) if closed or width >= NO_MIRROR * height else (None, False)


def proposal(sample: Sequence[DecodedImage], circle: Circle | None = None, given: bool = False) -> str | None:
    """The sentence that proposes a kind of panorama for images that would be taken for mirror pictures.

    Where a whole circle was found in them, or one was given, only if they close on themselves, or are as wide as no mirror's
    frame.
    """
    kind, closed = proposed(sample)
    height, width = sample[0].shape
    circle_was_found = given or (circle is not None and is_whole(circle, height))
    if kind is None or (circle_was_found and not closed and width < NO_MIRROR * height):
        return None
    shape = "2:1" if kind is Panorama.equirectangular else f"{width / height:.3g}:1"
    ends = " and their right edge continues at the left" if closed else ""
    if not closed and closes(sample) is False:
        ends = ", but their right edge does not continue at the left"
    camera = panorama_camera(kind, width, height)
    return (
        f"the pictures are {shape}{ends}, as {PLURALS[kind]} are: give sensor.panorama={kind.value} (elevations from"
        f" {camera.lowest_deg:.0f} to {camera.highest_deg:.0f} degrees; others: camera.json); without it they are taken for"
        " mirror pictures, whose circle sensor.circle_px=[cx,cy,radius] gives"
    )


def doubt(sample: Sequence[DecodedImage]) -> str | None:
    """Why images that are declared to be panoramas over 360 degrees may be none; None if nothing speaks against it."""
    closed = closes(sample)
    if closed:
        return None
    if (circle := _mirror(sample)) is not None:
        return (
            f"the pictures are declared to be panoramas, but show a circle in a dark surround (centre {circle.cx:.0f},"
            f" {circle.cy:.0f}, radius {circle.radius:.0f}), as mirrors and fisheyes do. If so, leave out"
        )
    if closed is None:
        return None
    return (
        "the right edges of the pictures do not continue at their left: are they panoramas over 360 degrees? If not,"
        " leave out"
    )


def _mirror(sample: Sequence[DecodedImage]) -> Circle | None:
    """The circle that a dark surround shows in images no wider than a mirror's frame may be."""
    height, width = sample[0].shape
    if width >= NO_MIRROR * height:
        return None
    try:
        circle = circle_of(None, sample)
    except DataError:
        return None
    return None if circle == inscribed((height, width)) or not is_whole(circle, height) else circle


def is_whole(circle: Circle, height: int) -> bool:
    """Whether a frame so high shows a circle from top to bottom, give or take a tenth of its radius.

    Of a sphere whose ends are dark one may be found that reaches far beyond the frame.
    """
    slack = 0.1 * circle.radius
    return circle.radius <= circle.cy + slack and circle.cy + circle.radius <= height - 1 + slack


def closes(sample: Sequence[DecodedImage]) -> bool | None:
    """Whether the right edges of images continue at their left; None where the edges are plain and cannot tell.

    First and last column of N images (N, H, W) are correlated over rows and images, beside neighbouring columns. Of three
    images and more their mean is taken off first: what never changes, a dark surround say, tells nothing; nor do
    images whose columns are all alike.
    """
    pixels = np.stack([image.pixels for image in sample]).astype(np.float32)
    moving = len(pixels) >= MOVING
    pixels -= pixels.mean(axis=0) if moving else pixels.mean(axis=2, keepdims=True)
    power = (pixels**2).mean(axis=(0, 1))
    if min(power[0], power[-1]) <= max(PLAIN * float(np.median(power)), 1) or not (moving or _lively_ends(sample)):
        return None
    near = _likeness(pixels, power, 1)
    usual, ends = float(np.median(near)), float(near[-1])  # the last column's neighbour is the first
    if usual < LIKE_NEIGHBOURS or float(np.median(_likeness(pixels, power, pixels.shape[2] // 2))) >= CLOSES * usual:
        return None
    if ends >= CLOSES * usual:
        return True
    clear = min(float(near[0]), float(near[-2])) >= 0.5 * usual  # noise on plain columns is like nothing beside it
    return False if clear and ends <= APART * usual else None


def _likeness(pixels: Floats, power: Floats, apart: int) -> Floats:
    """The correlation of each column with the one so far to its right, around; pixels are (N, H, W), both others (W,)."""
    alike: Floats = (pixels * np.roll(pixels, -apart, axis=2)).mean(axis=(0, 1))
    return alike / np.sqrt(power * np.roll(power, -apart) + 1e-6)


def _lively_ends(sample: Sequence[DecodedImage]) -> bool:
    """Whether the first and the last column vary along their height, half as much as columns usually do."""
    contrast = np.stack([image.pixels for image in sample]).std(axis=1).mean(axis=0)
    return bool(min(contrast[0], contrast[-1]) > max(0.5 * float(np.median(contrast)), 1))
