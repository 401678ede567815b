"""Trajectories in the format of the TUM RGB-D benchmark: `timestamp tx ty tz qx qy qz qw`, a pose per line."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from omnilab.api import Floats
from omnilab.errors import DataError
from omnilab.geometry import rotation_of_quaternion
from omnilab_recordings.positions import LARGEST_FILE, MOST_ROWS, Positions

Ints = npt.NDArray[np.integer[Any]]

SUFFIXES = frozenset({".txt", ".tum"})
NEAR_NS = 20_000_000  # between the stamp of an image and of its pose: the benchmark's own tolerance
LATEST_S = 9e9  # nanoseconds must fit 64 bits


def read_trajectory(file: Path, images: Sequence[str]) -> Positions:
    """Where images were taken, by a trajectory.

    Images named by their stamp in seconds, such as 1305031102.175304.png, take the pose nearest in time, others the
    poses in their order. DataError names the line that is no pose, or the images that have none.
    """
    stamps_ns, values = _poses(file)
    names = [Path(image).stem for image in images]
    if all(re.fullmatch(r"\d{1,10}\.\d{1,9}", name) for name in names):
        rows = _nearest(file, images, np.array([_nanoseconds(name) for name in names], np.int64), stamps_ns)
    elif len(images) == len(stamps_ns):
        rows = np.arange(len(images))
    else:
        raise DataError(
            f"{file} has {len(stamps_ns)} poses for {len(images)} images; give as many,"
            " or name the images by their stamps in seconds (1305031102.175304.png)"
        )
    return Positions(list(images), values[rows, :3], rotation_of_quaternion(values[rows, 3:]), None, stamps_ns[rows])


def _poses(file: Path) -> tuple[Ints, Floats]:
    """Stamps (N,) in nanoseconds, and positions and quaternions (N, 7)."""
    if file.stat().st_size > LARGEST_FILE:
        raise DataError(f"{file} is larger than {LARGEST_FILE >> 20} MiB; split the recording into several folders")
    stamps, values = [], []
    for number, line in enumerate(file.read_text(encoding="utf-8", errors="replace").splitlines(), start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        if (pose := _pose(words)) is None:
            raise DataError(f"line {number} of {file} is {line[:60]!r}; write timestamp tx ty tz qx qy qz qw")
        stamps.append(_nanoseconds(words[0]))
        values.append(pose)
    if not 0 < len(stamps) <= MOST_ROWS:
        raise DataError(f"{file} has {len(stamps)} poses; give at least 1 and at most {MOST_ROWS}")
    return np.array(stamps, np.int64), np.array(values)


def _pose(words: Sequence[str]) -> list[float] | None:
    """Position and quaternion, unless the words are no pose with its stamp."""
    try:
        stamp, *pose = map(float, words)
    except ValueError:
        return None
    good = len(pose) == 7 and all(map(math.isfinite, pose)) and any(pose[3:]) and abs(stamp) < LATEST_S
    return pose if good else None


def _nanoseconds(seconds: str) -> int:
    return int(Decimal(seconds) * 10**9)


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
