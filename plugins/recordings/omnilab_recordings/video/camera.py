"""Sensor `camera`: frames of a device, an address or a file, as they come."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from omnilab.api import Bytes, Frames, Mesh, Plan, PoseRequest, RecordedPoses, check_settings, setting
from omnilab.errors import DataError
from omnilab.image import to_gray
from omnilab_recordings.calibration import CameraFile
from omnilab_recordings.camera_choice import CameraChoice, blanked
from omnilab_recordings.images.decoding import DecodedImage, Decoder
from omnilab_recordings.images.headers import ImageHeader
from omnilab_recordings.optics import Optics, check_circle, check_size
from omnilab_recordings.panoramas import Panorama, panorama_kind
from omnilab_recordings.streams.image_stream import image_name
from omnilab_recordings.video.live_source import LiveAddress, LiveFrame, LiveFrames
from omnilab_recordings.video.pixels import LumaRange, image_of

log = logging.getLogger("omnilab")


@dataclass
class LiveCamera:
    """A camera that is plugged in, an address on this machine, or a file that is played as if it were live.

    Frames come when they are taken and wait for nobody: what comes while the study is at work is held, `buffer` frames at most,
    of which the oldest is dropped. Their times are those of their arrival on this machine, since 1970. A camera that is
    unplugged or falls silent ends the recording: what came before is kept. Where it was nobody knows, so nothing is scored,
    and what was seen once cannot be seen again.
    """

    path: str = "0"  # a device's number or path, an address (http, rtsp, ...), or a file
    count: int = setting(1000, at_least=1, at_most=1_000_000)  # of frames, after which it ends
    buffer: int = setting(2, at_least=1, at_most=100)  # frames that wait at most
    silence_s: float = setting(5.0, above=0, at_most=3600)  # without a frame, after which it has ended
    allow_network: bool = False  # true: an address on another machine is meant
    rate: float | None = setting(None, above=0, at_most=10_000)  # frames a second of a device; null: its own
    size_px: list[int] | None = setting(None, at_least=1, at_most=65_536, count=2)  # of a device; null: its own
    camera: str | None = None  # its calibration (formats: docs/cameras.md); null: none
    looks: str | None = None  # where that leaves it open: down, up or ahead; null: ahead of pinholes, else down
    entry: str | None = None  # which camera of a calibration with several, such as cam1
    distortion: str | None = None  # of OpenCV's files that do not say: radtan (pinhole) or equidistant (fisheye)
    panorama: Panorama | None = None  # equirectangular, strip or dual_fisheye: of a 360-degree camera
    circle_px: list[float] | None = setting(None, at_least=-1e6, at_most=1e6)  # cx, cy, radius[, inner]; null: found
    sky_inside: bool = False  # the horizon is crossed inwards: the sky is at the centre
    blank_outside: bool = False  # set what lies off the circle's ring to 0
    mask: str | None = None  # an image of the same size: where it is dark, all images are set to 0
    mirrored: bool = False  # azimuth runs clockwise in the images
    color: bool = False  # RGB instead of grey
    range: LumaRange = LumaRange.auto  # of luma: auto (as the source says), full (0 to 255) or limited (16 to 235)

    live: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_settings(self)
        if self.circle_px is not None:
            check_circle(self.circle_px)
        if self.panorama is not None:
            self.panorama = panorama_kind(self.panorama)
        self._address()

    def plan(self, layout: PoseRequest) -> Plan:
        """The frames that are wanted, none of which is there yet."""
        name = self._address().name
        if layout != RecordedPoses():
            raise DataError(f"{name} shows what comes, at no pose that is asked for; ask for all that is recorded")
        return Plan([image_name(name, i) for i in range(self.count)], None)

    def frames(self, plan: Plan) -> Iterator[Frames]:
        """Frames one by one as they come, as many as the plan has, or fewer: what ended it is a warning.

        DataError where not one came.
        """
        source, name = LiveFrames(self._address(), self.buffer), self._address().name
        optics: Optics | None = None
        came = 0
        try:
            for found in source.take():
                image = image_of(found.frame, self.color, self.range)
                optics = optics or self._optics(image)
                check_size(image.shape[:2], optics.unseen.shape, plan.keys[came])
                yield self._packed(plan, came, found, image, optics)
                came += 1
                if came == len(plan):
                    break
        finally:
            source.close()
        if not came:
            raise DataError(f"{name} delivered no frame ({source.ended}); see that it is switched on")
        if came < len(plan):
            log.warning(
                "%s ended after %d of %d frames (%s): what came before is kept", name, came, len(plan), source.ended
            )
        if source.dropped:
            log.warning(
                "%s: %d frames came while %d others waited, and were dropped", name, source.dropped, self.buffer
            )

    def scene(self) -> Mesh | None:
        """None: nothing is known of the world but its images."""
        return None

    def _address(self) -> LiveAddress:
        size = None if self.size_px is None else (self.size_px[0], self.size_px[1])
        return LiveAddress(self.path, self.allow_network, self.silence_s, self.rate, size)

    def _optics(self, first: Bytes) -> Optics:
        """The camera of the images, as settings say or as the first one shows it."""
        file = None if self.camera is None else CameraFile(self.camera, self.looks, self.entry, self.distortion)
        choice = CameraChoice(file, self.panorama, self.circle_px, self.sky_inside)
        grey = to_gray(first[None])[0]
        shape = grey.shape[0], grey.shape[1]
        sample = [DecodedImage(grey, ImageHeader("live", width=shape[1], height=shape[0]), shape).reduced()]
        camera = choice.camera(Path(), sample)
        for sentence in choice.remarks(camera, sample).values():
            log.warning("%s: %s", self._address().name, sentence)
        unseen = blanked(camera, Path(), self.mask, self.blank_outside)
        return Optics(camera.flipped() if self.mirrored else camera, unseen, self.mirrored, Decoder(self.color), False)

    def _packed(self, plan: Plan, index: int, found: LiveFrame, image: Bytes, optics: Optics) -> Frames:
        return Frames(
            images=optics.prepared(image)[None],
            keys=[optics.key(plan.keys[index], image.tobytes())],
            stamps_ns=np.array([found.stamp_ns], np.int64),
            camera=optics.camera,
            plan_index=np.array([index]),
        )
