"""Pictures that are panoramas already: their cameras, and how they are told from mirror pictures."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum

import numpy as np

from omnilab.cameras import CylindricalCamera, EquirectangularCamera
from omnilab.errors import ConfigError, DataError
from omnilab_recordings.images.decoding import DecodedImage

FRONT_IN_THE_MIDDLE_DEG = 180.0  # azimuth of column 0
CLOSELY = 6  # images that are looked at
CLOSES, APART = (
    2.0,
    0.5,
)  # times the difference of neighbouring columns, and of opposite ones, that its ends may differ by


class Panorama(Enum):
    """Panoramas over 360 degrees as cameras and phones lay them out: the front in the middle, azimuth clockwise."""

    equirectangular = "equirectangular"  # rows evenly spaced in elevation; 2:1 is the whole sphere
    strip = "strip"  # a cylinder: verticals are straight, rows evenly spaced in height on it


def panorama_kind(name: Panorama | str) -> Panorama:
    """The kind of panorama by its name; ConfigError, with the kinds there are, if it is none."""
    try:
        return Panorama(name)
    except ValueError:
        kinds = ", ".join(kind.value for kind in Panorama)
        raise ConfigError(f"panorama={name!r} is none that is read; give one of {kinds}, or null") from None


PLURALS = {Panorama.equirectangular: "equirectangular panoramas", Panorama.strip: "panoramic strips"}


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
    if width < 1.98 * height:
        return None, False
    closed = any(image.header.equirectangular for image in sample) or closes(sample) is True
    if width <= 2.02 * height:
        return Panorama.equirectangular, closed
    return (Panorama.strip, closed) if closed or width >= 3 * height else (None, False)


def proposal(sample: Sequence[DecodedImage]) -> str | None:
    """The sentence that proposes a kind of panorama for images that would be taken for mirror pictures."""
    kind, closed = proposed(sample)
    if kind is None:
        return None
    height, width = sample[0].shape
    shape = "2:1" if kind is Panorama.equirectangular else f"{width / height:.3g}:1"
    ends = " and their right edge continues at the left" if closed else ""
    camera = panorama_camera(kind, width, height)
    return (
        f"the pictures are {shape}{ends}, as {PLURALS[kind]} are: give sensor.panorama={kind.value} (elevations from"
        f" {camera.lowest_deg:.0f} to {camera.highest_deg:.0f} degrees; others: camera.json); without it they are taken for"
        " mirror pictures, whose circle sensor.circle_px=[cx,cy,radius] gives"
    )


def closes(sample: Sequence[DecodedImage]) -> bool | None:
    """Whether the right edges of images continue at their left; None where the edges are plain and cannot tell."""
    columns = np.stack([image.pixels for image in sample[:CLOSELY]]).astype(np.int16)
    contrast = columns.std(axis=1).mean(axis=0)  # of each column
    if min(contrast[0], contrast[-1]) <= max(APART * float(np.median(contrast)), 1):
        return None
    ends = float(np.abs(columns[:, :, 0] - columns[:, :, -1]).mean())
    neighbours = float(np.abs(np.diff(columns, axis=2)).mean())
    opposite = float(np.abs(columns - np.roll(columns, columns.shape[2] // 2, axis=2)).mean())
    return ends < CLOSES * neighbours + 1 and ends < APART * opposite
