"""Poses of a stream's images: those of a trajectory, interpolated at the images' times."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from omnilab.api import Bools, Floats, Ints
from omnilab.errors import DataError
from omnilab.trajectory import clocks, plausibility
from omnilab.trajectory.files import Trajectory, read_trajectory
from omnilab.trajectory.interpolation import interpolate

SECOND_NS = 10**9


@dataclass(frozen=True)
class PoseSource:
    """Poses (N, 4, 4) at ascending times (N,), on the clock of the images once they are shifted."""

    T_world_camera: Floats
    stamps_ns: Ints
    of: str  # what they are from, in sentences

    def shifted(self, offset_s: float) -> PoseSource:
        """The same, so much later."""
        return replace(self, stamps_ns=self.stamps_ns + round(offset_s * SECOND_NS))

    def at(self, images_ns: Ints, tolerance_s: float) -> tuple[Floats, Bools]:
        """Poses (M, 4, 4) of images at times (M,), and which have one (M,); DataError, with both spans, if none has."""
        T, known = interpolate(self.T_world_camera, self.stamps_ns, images_ns, round(tolerance_s * SECOND_NS))
        if not known.any():
            raise DataError(self._none_near(images_ns, tolerance_s))
        return T, known

    def left_out(self, tolerance_s: float) -> str:
        """Why an image has no pose, behind its name; what would give it one, where poses are seldom."""
        apart = self._apart_s()
        remedy = f"; poses are {apart:.3g} s apart: give sensor.tolerance_s={apart:.2g}" if apart > tolerance_s else ""
        return f"has no pose within {tolerance_s:g} s on both sides in {self.of}{remedy}"

    def _none_near(self, images_ns: Ints, tolerance_s: float) -> str:
        if clocks.overlap(images_ns, self.stamps_ns):
            return f"none of {len(images_ns)} images at {clocks.span(images_ns)} {self.left_out(tolerance_s)}"
        shift = (int(images_ns.min()) - int(self.stamps_ns.min())) / SECOND_NS
        shifted = (
            f"give what lies between them, sensor.clock_offset_s={shift:.3f} if both begin together,"
            " or have it estimated with sensor.estimate_offset=true"
        )
        return clocks.differ(images_ns, self.stamps_ns, self.of, shifted=shifted)

    def _apart_s(self) -> float:
        """The usual time between two poses."""
        return float(np.median(np.diff(self.stamps_ns))) / SECOND_NS if len(self.stamps_ns) > 1 else 0.0


def poses_of_file(file: str) -> PoseSource:
    """Poses of a trajectory file; DataError if it holds no times, or these do not ascend."""
    path = read_trajectory(Path(file), lenient=True, level=True)
    plausibility.warn(file, path)
    if path.stamps_ns is None:
        raise DataError(
            f"{file} says where the camera was, and not when; give poses with times, in TUM's format or a CSV with stamp_s"
        )
    return source_of(path, path.stamps_ns, file)


def source_of(path: Trajectory, stamps_ns: Ints, of: str) -> PoseSource:
    """The poses of a trajectory; DataError if their times do not ascend."""
    if (np.diff(stamps_ns) <= 0).any():
        row = int(np.argmax(np.diff(stamps_ns) <= 0)) + 2
        raise DataError(f"pose {row} of {of} is not later than the one before it; sort the poses by time")
    return PoseSource(path.T_world_camera, stamps_ns, of)
