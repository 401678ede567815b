"""Trees of frames: T_world_camera along a chain of transforms that change with time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from omnilab.api import Floats, Ints
from omnilab.errors import DataError
from omnilab.geometry import poses, rotation_of_quaternion
from omnilab.trajectory.interpolation import interpolate
from omnilab_recordings.bags.decoding import TransformMessage

EVER_NS = 2**62


@dataclass(frozen=True)
class FrameTrack:
    """T_parent_child (N, 4, 4) at ascending times (N,); one alone holds at all times."""

    parent: str
    T: Floats
    stamps_ns: Ints

    @property
    def is_static(self) -> bool:
        return len(self.T) == 1

    def at(self, stamps_ns: Ints) -> Floats:
        """Poses (M, 4, 4) at times within its own."""
        return (
            np.repeat(self.T, len(stamps_ns), axis=0)
            if self.is_static
            else interpolate(self.T, self.stamps_ns, stamps_ns, EVER_NS)[0]
        )


def track_of(transforms: Sequence[TransformMessage], of: str) -> FrameTrack:
    """Transforms of one child in their order; of several at one time the last. DataError for numbers that are no pose."""
    stamps = np.array([one.stamp_ns for one in transforms], np.int64)
    position_m = np.array([one.position_m for one in transforms])
    quaternion = np.array([one.quaternion_xyzw for one in transforms])
    length = np.linalg.norm(quaternion, axis=1)
    if not (np.isfinite(position_m).all() and (np.abs(length - 1) < 0.01).all()):
        raise DataError(
            f"{of} has poses that are none (no unit quaternions, or numbers that are not finite); leave them out"
        )
    order = np.argsort(stamps, kind="stable")
    last = np.r_[np.diff(stamps[order]) > 0, True]
    kept = order[last]
    T = poses(position_m[kept], rotation_of_quaternion(quaternion[kept]))
    if (T[:1] == T).all():  # one that is repeated is static
        T, kept = T[:1], kept[:1]
    return FrameTrack(transforms[0].parent, T, stamps[kept])


class FrameTree:
    """Which frame hangs from which, and how."""

    def __init__(self, transforms: Iterable[TransformMessage], of: str) -> None:
        by_child: dict[str, list[TransformMessage]] = {}
        for one in transforms:
            by_child.setdefault(_name(one.child), []).append(one)
        self._tracks: dict[str, FrameTrack] = {}
        for child, found in by_child.items():
            parents = sorted({_name(one.parent) for one in found})
            if len(parents) > 1:
                raise DataError(
                    f"{of} has the frame {child} hang from {' and from '.join(parents)}; give a topic of poses, sensor.poses=TOPIC"
                )
            self._tracks[child] = track_of(found, f"{of}, {parents[0]} to {child}")

    def __contains__(self, frame: str) -> bool:
        return _name(frame) in self._tracks

    def chain(self, frame: str, top: str | None = None) -> list[str]:
        """Frames from one up to its root, or to one that is named."""
        found = [_name(frame)]
        while found[-1] in self._tracks and found[-1] != (None if top is None else _name(top)):
            found.append(_name(self._tracks[found[-1]].parent))
            if found[-1] in found[:-1]:
                raise DataError(
                    f"the frames {', '.join(found)} hang from each other in a circle; give sensor.poses=TOPIC"
                )
        return found

    def poses(self, frame: str, top: str) -> tuple[Floats, Ints] | None:
        """T_top_frame (N, 4, 4) at times (N,); times () where nothing on the way moves. None if there is no way."""
        chain = self.chain(frame, top)
        if chain[-1] != _name(top):
            return None
        tracks = [self._tracks[child] for child in chain[:-1]]
        moving = [track for track in tracks if not track.is_static]
        stamps: Ints = np.zeros(0, np.int64)
        if moving:
            stamps = max(moving, key=lambda track: len(track.T)).stamps_ns
            first, last = (max(t.stamps_ns[0] for t in moving), min(t.stamps_ns[-1] for t in moving))
            stamps = stamps[(stamps >= first) & (stamps <= last)]
        T = np.eye(4)[None]
        for track in tracks:
            T = track.at(stamps if moving else np.zeros(1, np.int64)) @ T
        return T, stamps


def _name(frame: str) -> str:
    """A frame's name; those of tf began with a slash."""
    return frame.removeprefix("/")
