"""Sensor `video`: the frames of a video file."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from omnilab.api import setting
from omnilab.errors import ConfigError
from omnilab_recordings.on_bad_image import OnBadImage
from omnilab_recordings.streams.sensor import StreamSensor
from omnilab_recordings.video.index import index_of
from omnilab_recordings.video.pixels import LumaRange
from omnilab_recordings.video.reader import FrameReader
from omnilab_recordings.video.stream import VideoImages


class Clock(Enum):
    """What the times of frames count from."""

    file = "file"  # as the file has them, mostly from its first frame on
    created = "created"  # since 1970, the file's times after when it was begun, which it mostly knows to a second


@dataclass
class Video(StreamSensor):
    """A video file, in any format and coding that FFmpeg decodes: .mp4, .mkv, .avi, .mov, .webm, ...

    Times are those of the container, also where they are uneven. All of the file is read once for an index of its frames;
    then any frame is decoded from the key frame before it, the same bit for bit as from the beginning. Where data are
    damaged, frames up to the next key frame are left out. Grey is the luma of the file, stretched to 0 to 255 where the file
    uses 16 to 235. A panorama of 360-degree cameras is declared by `panorama`: equirectangular, strip, or dual_fisheye for
    two circles side by side that nobody has stitched yet (calibrated: `camera`, a DualFisheyeCamera).
    """

    track: int = setting(0, at_least=0, at_most=100)  # which of several video streams in the file
    upright: bool = True  # turn frames as the file says, as players do; or take them as stored
    range: LumaRange = LumaRange.auto  # of luma: auto (as the file says), full (0 to 255) or limited (16 to 235)
    clock: Clock = Clock.file  # of the frames' times: file, or created (since 1970)
    on_bad_image: OnBadImage = OnBadImage.skip  # damaged frames are left out and listed; or fail

    def open_stream(self) -> VideoImages:
        """The video with its index."""
        path = Path(self.path)
        index = index_of(path, self.track)
        reader = FrameReader(path, index, self.track, self.color, self.upright, self.range)
        if self.clock is Clock.file:
            return VideoImages(reader, index.stamps_ns)
        if index.created_ns is None:
            raise ConfigError(
                f"sensor.clock=created, but {path} does not say when it was begun; give sensor.clock=file, and"
                " sensor.clock_offset_s for poses on another clock"
            )
        return VideoImages(reader, index.stamps_ns + index.created_ns)
