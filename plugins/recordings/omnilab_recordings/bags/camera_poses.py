"""Where the camera of a log was: by a topic of poses, or by the tree of frames that its transforms make."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np

from omnilab.api import Floats
from omnilab.errors import ConfigError
from omnilab.trajectory.files import Trajectory
from omnilab_recordings.bags.decoding import POSES
from omnilab_recordings.bags.frames import FrameTrack, FrameTree, track_of
from omnilab_recordings.bags.log_index import LogIndex
from omnilab_recordings.optical_axes import optical_to_camera


class Axes(Enum):
    """How the axes of the frame lie in which images were taken."""

    optical = "optical"  # x to the right in the image, y down, z ahead (REP 103)
    body = "body"  # x ahead, y to the left, z up


@dataclass(frozen=True)
class CameraPoses:
    """What is said of the poses: by the settings of a sensor, and by the images."""

    frame: str  # of the images
    axes: Axes | None  # None: optical if the frame's name says so
    looks: str  # where an optical axis points: down, up or ahead
    world: str | None  # frame of the poses; None: the root of the tree
    topic: str | None  # of poses; None: the tree of frames

    def of(self, log: LogIndex, remarks: dict[str, str]) -> Trajectory | None:
        """T_world_camera in the frame of `omnilab.api`; None where the log does not tell. What was assumed is remarked."""
        trees = [one for topic, found in log.transforms.items() if _is_tree(log, topic) for one in found]
        tree = FrameTree(trees, str(log.path))
        found = self._by_topic(log, tree, remarks) if self.topic else self._by_tree(log, tree, remarks)
        if found is None:
            return None
        return Trajectory(found.T @ self._turned(remarks), found.stamps_ns)

    def _turned(self, remarks: dict[str, str]) -> Floats:
        """T_frame_camera (4, 4): from the axes of omnilab's camera to those of the frame."""
        T = optical_to_camera(self.looks) if self._optical else np.eye(4)
        assumed = f"x right, y down, z ahead, which here is {self.looks}" if self._optical else "x ahead, y left, z up"
        other = "body" if self._optical else "optical"
        remarks["axes"] = (
            f"the frame of the images, {self.frame or '(no name)'}, is taken to have {assumed}; else give sensor.axes={other}"
        )
        return T

    @property
    def _optical(self) -> bool:
        return "optical" in self.frame if self.axes is None else self.axes is Axes.optical

    def _by_tree(self, log: LogIndex, tree: FrameTree, remarks: dict[str, str]) -> FrameTrack | None:
        topics = [topic for topic in sorted(log.transforms) if not _is_tree(log, topic)]
        other = f"; give sensor.poses=TOPIC, one of {', '.join(topics)}" if topics else ""
        if self.frame not in tree:
            if self.world is not None:
                raise ConfigError(
                    f"world={self.world}, but {log.path} has no transform to the frame of the images, {self.frame!r}{other}"
                )
            if topics:
                remarks["poses"] = (
                    f"the images are without poses, as no transform leads to their frame {self.frame!r}{other}"
                )
            return None
        chain = tree.chain(self.frame, self.world)
        found = tree.poses(self.frame, self.world or chain[-1])
        if found is None:
            raise ConfigError(
                f"world={self.world} is not above {self.frame} in the frames of {log.path}, {' < '.join(chain)}; give one of them"
            )
        T, stamps = found
        if not len(stamps):
            remarks["poses"] = f"the images are without poses, as nothing moves from {chain[-1]} to {self.frame}{other}"
            return None
        remarks["poses of"] = f"poses are those of {' > '.join(reversed(chain))}"
        return FrameTrack(chain[-1], T, stamps)

    def _by_topic(self, log: LogIndex, tree: FrameTree, remarks: dict[str, str]) -> FrameTrack | None:
        """Poses of a topic and, where the tree has it, the way from their body to the camera."""
        assert self.topic is not None
        track = _of_topic(log, self.topic)
        found = log.transforms[self.topic]
        body = found[0].child
        mount = tree.poses(self.frame, body) if body and self.frame else None
        if mount is None or len(mount[1]):
            remarks["poses of"] = (
                f"poses are those of {self.topic}, {found[0].parent or 'a frame'} to {body or 'a body'}, and the camera is taken to be there"
            )
            return track
        remarks["poses of"] = (
            f"poses are those of {self.topic}, {found[0].parent} to {body}, and from there to the camera's frame {self.frame}"
        )
        return FrameTrack(track.parent, track.T @ mount[0][0], track.stamps_ns)


def trajectory_of(file: str, topic: str) -> Trajectory:
    """The poses of a topic of a log, of its body, on whichever axes that has."""
    track = _of_topic(LogIndex(Path(file)), topic)
    return Trajectory(track.T, track.stamps_ns)


def _of_topic(log: LogIndex, topic: str) -> FrameTrack:
    """The poses of a topic; ConfigError, with those that there are, if it has none."""
    if topic not in log.transforms or _is_tree(log, topic):
        others = [name for name in sorted(log.transforms) if not _is_tree(log, name)]
        kinds = f"it has {', '.join(others)}" if others else f"it has none of {', '.join(POSES)}"
        raise ConfigError(f"{topic} is no topic of poses in {log.path}; {kinds}")
    return track_of(log.transforms[topic], f"{log.path} {topic}")


def _is_tree(log: LogIndex, topic: str) -> bool:
    """Whether a topic's transforms are of a tree of frames, and not the poses of one body."""
    return log.topics[topic] not in POSES
