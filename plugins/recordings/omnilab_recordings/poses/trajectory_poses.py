"""Poses of images from a trajectory (TUM's or KITTI's format), matched by stamp or by order."""

from __future__ import annotations

import re
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path

import numpy as np

from omnilab.api import Ints
from omnilab.errors import DataError
from omnilab.trajectory import clocks
from omnilab.trajectory.tables import PoseTable
from omnilab_recordings.poses.positions import Positions

NEAR_NS = 20_000_000  # between the stamp of an image and of its pose: the benchmark's own tolerance
AS_SECONDS = "name the images by their stamps in seconds (1305031102.175304.png)"


def poses_of_images(table: PoseTable, images: Sequence[str]) -> Positions:
    """Poses of images (N,) by a trajectory, which has no column for them.

    Images named by their stamp, in seconds with a point (1305031102.175304.png) or in whole milli-, micro- or nanoseconds
    since 1970, take the pose nearest in time, others the poses in their order. DataError names the line that is no pose,
    or the images that have none.
    """
    position_m, R, stamps_ns = table.position_m(), table.rotations(lenient=True), table.stamps_ns()
    rows = _rows(table.file, images, len(R), stamps_ns)
    stamps = None if stamps_ns is None else stamps_ns[rows]
    return Positions(list(images), position_m[rows], R[rows], None, stamps, table.turn)


def _rows(file: Path, images: Sequence[str], count: int, stamps_ns: Ints | None) -> Ints:
    """Which of the poses each image takes (N,)."""
    names = [Path(image).stem for image in images]
    if stamps_ns is not None and all(re.fullmatch(r"\d{1,10}\.\d{1,9}", name) for name in names):
        return _nearest(file, images, np.array([int(Decimal(name) * 10**9) for name in names], np.int64), stamps_ns)
    whole = clocks.stamps_of_names(names)
    if stamps_ns is not None and whole is not None and (clocks.overlap(whole, stamps_ns) or len(images) != count):
        return _nearest(file, images, whole, stamps_ns)
    if len(images) == count:
        return np.arange(count)
    raise DataError(f"{file} has {count} poses for {len(images)} images; give as many" + (
        f", or {AS_SECONDS}" if stamps_ns is not None else " (it holds no times)"))  # fmt: skip


def _nearest(file: Path, images: Sequence[str], wanted_ns: Ints, stamps_ns: Ints) -> Ints:
    order = np.argsort(stamps_ns, kind="stable")
    after = np.searchsorted(stamps_ns[order], wanted_ns)
    around = order[np.stack([after - 1, after]).clip(0, len(order) - 1)]
    rows = np.take_along_axis(around, np.abs(stamps_ns[around] - wanted_ns).argmin(axis=0)[None], axis=0)[0]
    far = np.abs(stamps_ns[rows] - wanted_ns) > NEAR_NS
    if far.all() and not clocks.overlap(wanted_ns, stamps_ns):
        raise DataError(clocks.differ(wanted_ns, stamps_ns, str(file), "the images are named by times of"))
    if far.any():
        raise DataError(
            f"{file} has no pose within {NEAR_NS / 1e9} s of {far.sum()} of {len(images)} images,"
            f" {images[int(np.argmax(far))]} say; narrow sensor.pattern to those on the trajectory"
        )
    return np.asarray(rows)
