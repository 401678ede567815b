"""Poses of images from a trajectory in the format of the TUM RGB-D benchmark, matched by stamp or by order."""

from __future__ import annotations

import re
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path

import numpy as np

from omnilab.api import Floats, Ints
from omnilab.errors import DataError
from omnilab.trajectory.files import MOST_POSES, NoPoseError, PoseLineError, read_trajectory
from omnilab_recordings.poses.positions import Positions

SUFFIXES = frozenset({".txt", ".tum"})
NEAR_NS = 20_000_000  # between the stamp of an image and of its pose: the benchmark's own tolerance


def poses_of_images(file: Path, images: Sequence[str]) -> Positions:
    """Poses of images (N,) by a trajectory.

    Images named by their stamp in seconds, such as 1305031102.175304.png, take the pose nearest in time, others the
    poses in their order. DataError names the line that is no pose, or the images that have none.
    """
    T, stamps_ns = _trajectory(file)
    names = [Path(image).stem for image in images]
    if all(re.fullmatch(r"\d{1,10}\.\d{1,9}", name) for name in names):
        rows = _nearest(file, images, np.array([int(Decimal(name) * 10**9) for name in names], np.int64), stamps_ns)
    elif len(images) == len(stamps_ns):
        rows = np.arange(len(images))
    else:
        raise DataError(
            f"{file} has {len(stamps_ns)} poses for {len(images)} images; give as many,"
            " or name the images by their stamps in seconds (1305031102.175304.png)"
        )
    return Positions(list(images), T[rows, :3, 3], T[rows, :3, :3], None, stamps_ns[rows])


def _trajectory(file: Path) -> tuple[Floats, Ints]:
    """Poses (N, 4, 4) and stamps (N,) in nanoseconds; DataError in the words of a folder of images."""
    try:
        found = read_trajectory(file, lenient=True)
    except PoseLineError as error:
        line = " ".join(error.values)[:60]
        raise DataError(f"line {error.number} of {file} is {line!r}; write timestamp tx ty tz qx qy qz qw") from error
    except NoPoseError as error:
        raise DataError(f"{file} has 0 poses; give at least 1 and at most {MOST_POSES}") from error
    assert found.stamps_ns is not None  # TUM's format has them
    return found.T_world_camera, found.stamps_ns


def _nearest(file: Path, images: Sequence[str], wanted_ns: Ints, stamps_ns: Ints) -> Ints:
    order = np.argsort(stamps_ns, kind="stable")
    after = np.searchsorted(stamps_ns[order], wanted_ns)
    around = order[np.stack([after - 1, after]).clip(0, len(order) - 1)]
    rows = np.take_along_axis(around, np.abs(stamps_ns[around] - wanted_ns).argmin(axis=0)[None], axis=0)[0]
    far = np.abs(stamps_ns[rows] - wanted_ns) > NEAR_NS
    if far.any():
        raise DataError(
            f"{file} has no pose within {NEAR_NS / 1e9} s of {far.sum()} of {len(images)} images,"
            f" {images[int(np.argmax(far))]} say; narrow sensor.pattern to those on the trajectory"
        )
    return np.asarray(rows)
