"""What a recording of images in one file or folder is to the sensors that play it back."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Protocol

from omnilab.api import Bytes, Ints
from omnilab.cameras import RayCamera
from omnilab.trajectory.files import Trajectory


class ImageStream(Protocol):
    """N images in one order, which are decoded as they are requested.

    `camera` and `poses` are None where the recording does not know them. A camera is of the images as `pictures` gives
    them; poses are T_world_camera in the frame of `omnilab.api`, at ascending stamps on the clock of the images.
    """

    @property
    def name(self) -> str:
        """Of the recording, as sentences and keys have it: drive.mp4, or drive.bag /camera/image_raw."""

    @property
    def stamps_ns(self) -> Ints:
        """When its images were taken (N,), int64, known without decoding one."""

    @property
    def camera(self) -> RayCamera | None: ...
    @property
    def poses(self) -> Trajectory | None: ...
    @property
    def remarks(self) -> Mapping[str, str]:
        """What was assumed or reduced, a sentence a topic: each is logged once."""

    def pictures(self, rows: Ints) -> Iterator[Bytes | str]:
        """The images in ascending rows, one by one: pixels (H, W) or RGB (H, W, 3), or the sentence why there are none.

        The sentence names the image, as `image_name` does. Arrays are the caller's own. No more than a few images are in
        memory at a time, whatever the number of rows; rows may be few and far apart.
        """


def image_name(stream: str, row: int) -> str:
    """The name of an image of a stream, in keys and sentences."""
    return f"{stream}#{row}"
