"""The images of one topic of a log as a stream."""

from __future__ import annotations

import json
from collections.abc import Iterator
from enum import Enum
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from omnilab.api import Bytes, Ints
from omnilab.cameras import RayCamera
from omnilab.cameras.files import camera_of_info
from omnilab.errors import DataError
from omnilab.trajectory.files import Trajectory
from omnilab_recordings.bags.decoding import decoded_image
from omnilab_recordings.bags.log_index import LogIndex
from omnilab_recordings.bags.message import Damaged
from omnilab_recordings.bags.pixels import pixels_of, remark
from omnilab_recordings.streams.image_stream import image_name

SHOWN = 5  # topics in a sentence
CAMERA_FILE = "camera.json"  # an attachment of logs that `omnilab convert` writes


class Stamps(Enum):
    """Which times images have."""

    header = "header"  # when they were taken, as their headers say
    record = "record"  # when they were recorded


class BagStream:
    """See `ImageStream`; `poses` are set by the sensor, which knows the axes."""

    poses: Trajectory | None = None

    def __init__(
        self, log: LogIndex, topic: str, stamps: Stamps, looks: str | None, color: bool, info: str | None
    ) -> None:
        self.log, self.topic = log, topic
        self.name = f"{log.path} {topic}"
        self.remarks: dict[str, str] = {}
        self._looks, self._color, self._info = looks, color, info
        record, header, self._places = log.images[topic].in_time()
        self.stamps_ns = self._stamps(record, header, stamps)
        self._remark()

    @property
    def frame(self) -> str:
        """The frame in which the images were taken."""
        return self.log.images[self.topic].first.frame

    def _stamps(self, record: Ints, header: Ints, wanted: Stamps) -> Ints:
        if wanted is Stamps.record:
            return record
        if not header.any():
            self.remarks["stamps"] = f"the headers of {self.topic} hold no times, and those of recording are taken"
            return record
        back = int((np.diff(header) <= 0).sum())
        if back:
            self.remarks["stamps"] = (
                f"{back} of {len(header)} images of {self.topic} are not later than the one before, by the times of their headers"
                f"{' (some are 0)' if not header.all() else ''}; sensor.stamps=record takes the times of recording"
            )
        return header

    def _remark(self) -> None:
        if self.log.damage is not None:
            self.remarks["damage"] = f"the log is damaged, and what can be read of it is read: {self.log.damage}"
        if lost := self.log.unread:
            topics = ", ".join(f"{count} of {topic}" for topic, count in sorted(lost.items())[:SHOWN])
            self.remarks["unread"] = f"messages that are not whole are left out: {topics}"
        if (text := remark(self.log.images[self.topic].first)) is not None:
            self.remarks["encoding"] = text

    def pictures(self, rows: Ints) -> Iterator[Bytes | str]:
        """The images in some rows, one by one; see `ImageStream`."""
        try:
            for row in rows.tolist():
                name = image_name(self.name, row)
                try:
                    message = self.log.message(self.topic, *self._places[row])
                    yield pixels_of(decoded_image(message), name, self._color)
                except Damaged as damaged:
                    yield f"{name} cannot be read: {damaged}"
                except DataError as error:  # of a message, or of its pixels, which name the image
                    yield str(error) if str(error).startswith(name) else f"{name} {error}"
        finally:
            self.log.close()

    # ---------------------------------------------------------------------------------------------------------- camera
    @cached_property
    def camera(self) -> RayCamera | None:
        """As a calibration of the log has it; None if there is none."""
        if CAMERA_FILE in self.log.attachments:
            return camera_of_info(Path(f"{self.log.path}:{CAMERA_FILE}"), self._attached(), None)
        topic = self._calibration()
        if topic is None:
            return None
        values = self.log.calibrations[topic].values
        if not any(values["K"]):
            self.remarks["calibration"] = f"{topic} holds zeros: the camera was not calibrated"
            return None
        camera = camera_of_info(Path(f"{self.log.path} {topic}"), values, self._looks)
        looks = getattr(camera, "looks", None)
        self.remarks["calibration"] = f"the camera is that of {topic}, and looks {looks}" + (
            "" if self._looks else "; else give sensor.looks"
        )
        return camera

    def _attached(self) -> dict[str, Any]:
        try:
            found = json.loads(self.log.attachments[CAMERA_FILE])
        except (ValueError, RecursionError):
            found = None
        if not isinstance(found, dict):
            raise DataError(f"{self.log.path} has an attachment {CAMERA_FILE} that is none; give sensor.camera=FILE")
        return found

    def _calibration(self) -> str | None:
        """The topic of the calibration: the one beside the images or, of the images' frame, the only one."""
        known = self.log.calibrations
        if self._info is not None:
            if self._info not in known:
                listed = ", ".join(sorted(known)) or "none"
                raise DataError(
                    f"camera_info={self._info} is no calibration in {self.log.path}; those it has: {listed}"
                )
            return self._info
        parts = self.topic.split("/")
        beside = [topic for cut in (1, 2) if (topic := "/".join([*parts[:-cut], "camera_info"])) in known]
        of_frame = [topic for topic, found in known.items() if found.frame == self.frame]
        return beside[0] if beside else of_frame[0] if len(of_frame) == 1 else None
