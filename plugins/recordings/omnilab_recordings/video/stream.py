"""A video file as a stream of images."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from omnilab.api import Bytes, Ints
from omnilab.cameras import RayCamera
from omnilab.trajectory.files import Trajectory
from omnilab_recordings.video.reader import FrameReader


@dataclass
class VideoImages:
    """The frames of a video. It knows neither its camera nor where it was."""

    reader: FrameReader
    stamps_ns: Ints  # (N,)
    camera: RayCamera | None = None
    poses: Trajectory | None = None
    name: str = field(init=False)  # the file's own, without its folder
    remarks: Mapping[str, str] = field(init=False)

    def __post_init__(self) -> None:
        self.name, self.remarks = self.reader.path.name, self.reader.index.remarks

    def pictures(self, rows: Ints) -> Iterator[Bytes | str]:
        """The frames in ascending rows: decoding goes on where the next is near, or begins at the key frame before it."""
        return self.reader.pictures(int(row) for row in rows)
