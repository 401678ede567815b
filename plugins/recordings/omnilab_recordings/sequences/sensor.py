"""Sensor `sequence`: published sets of sequences as they are distributed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from omnilab.api import Bytes, Ints
from omnilab.cameras import RayCamera, load_camera
from omnilab.errors import DataError
from omnilab_recordings.images.decoding import Decoder
from omnilab_recordings.images.files import read_bytes
from omnilab_recordings.sequences.layouts import SequenceFiles, read_sequence
from omnilab_recordings.streams.image_stream import ImageStream, image_name
from omnilab_recordings.streams.sensor import StreamSensor


@dataclass
class ImageSequence(StreamSensor):
    """A folder as TUM (rgb.txt), EuRoC (mav0/cam0) or KITTI-360 (image_02/data_rgb) lays it out, with its poses and camera.

    Poses are of the camera, whose frame here has z up: sets have x right, y down, z ahead, and `looks` says which way
    that is (null: ahead). EuRoC's and KITTI-360's are of a body, from which their calibration leads to the camera.
    """

    which: str | None = None  # camera of the sequence: cam1, image_03, for TUM the listing; null: the first

    def open_stream(self) -> ImageStream:
        """The images; DataError where the folder has no such layout, or it is not whole."""
        looks = self.looks or "ahead"
        files = read_sequence(Path(self.path), self.which, looks)
        if not len(files.images):
            raise DataError(f"{self.path} holds no images; give the folder of the whole sequence")
        return SequenceStream(self.path, files, looks, self.color)


class SequenceStream:
    """See `ImageStream`."""

    def __init__(self, name: str, files: SequenceFiles, looks: str, color: bool) -> None:
        self.name, self.stamps_ns, self.poses = str(name), files.stamps_ns, files.poses
        self.remarks = {**files.remarks, "looks": f"the camera is taken to look {looks}; else give sensor.looks"}
        self._files, self._looks, self._decoder = files, looks, Decoder(color)

    @cached_property
    def camera(self) -> RayCamera | None:
        """As the set describes it; None if it does not."""
        file = self._files.camera
        return None if file is None or not file.is_file() else load_camera(file, looks=self._looks)

    def pictures(self, rows: Ints) -> Iterator[Bytes | str]:
        """The images in some rows, one by one; see `ImageStream`."""
        for row in rows.tolist():
            file = self._files.images[row]
            try:
                yield self._decoder.decode(read_bytes(file.parent, file.name), image_name(self.name, row)).pixels
            except DataError as error:
                yield str(error) if "#" in str(error) else f"{image_name(self.name, row)}: {error}"
