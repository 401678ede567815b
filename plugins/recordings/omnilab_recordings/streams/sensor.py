"""The common part of sensors that play a stream of images back."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from omnilab.api import Bytes, Floats, Frames, Ints, Mesh, Plan, PoseRequest, RecordedPoses, check_settings, setting
from omnilab.cameras import ImageCircle, RayCamera
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import rotation_xyz, wrap_angle
from omnilab.image import panorama, to_color, to_gray
from omnilab_recordings.calibration import CameraFile
from omnilab_recordings.camera_choice import CameraChoice, blanked
from omnilab_recordings.checks.turns import turn_between
from omnilab_recordings.images.decoding import DecodedImage, Decoder
from omnilab_recordings.images.headers import ImageHeader
from omnilab_recordings.on_bad_image import OnBadImage
from omnilab_recordings.optics import Optics, check_circle, check_size, most_alike
from omnilab_recordings.panoramas import Panorama, panorama_kind
from omnilab_recordings.remarks import RemarkLog
from omnilab_recordings.streams.clock_offset import estimate_offset
from omnilab_recordings.streams.image_stream import ImageStream, image_name
from omnilab_recordings.streams.poses import SECOND_NS, PoseSource, poses_of_file, source_of

log = logging.getLogger("omnilab")

SAMPLE = 16  # images by which the size and the circle of all are found
MOST_BYTES = 2**28  # of pictures that are handed over at a time
TURNS = 1500  # images whose turns are seen at most
TURN_SHAPE = (32, 512)  # of their panoramas


@dataclass
class StreamSensor:
    """What sensors of streams share: which images, whose poses, and the camera, which are set as those of `folder`.

    Poses are the recording's own or, with `positions`, those of another source on a clock of its own; they are
    interpolated at the images' times, and images without one are left out. `mirrored` and `turned_deg` are those of
    `folder`: `turned_deg` is the azimuth in the (flipped) picture of the direction that headings refer to.
    """

    path: str = "???"  # of the recording
    every: int = setting(1, at_least=1)  # each so many images
    from_s: float = setting(0.0, at_least=0, at_most=1e9)  # after the first image
    to_s: float | None = setting(None, above=0, at_most=1e9)  # after the first image; null: to the end
    positions: str | None = None  # poses of another source (a trajectory with times); null: the recording's own
    tolerance_s: float = setting(0.1, at_least=0, at_most=1e6)  # between an image and the pose before it or after it
    clock_offset_s: float = setting(0.0, at_least=-1e10, at_most=1e10)  # added to the poses' times
    estimate_offset: bool = False  # find it by the turns of images and of poses
    camera: str | None = None  # its calibration (formats: docs/cameras.md); null: the recording's own, or none
    looks: str | None = None  # where that leaves it open: down, up or ahead; null: ahead of pinholes, else down
    entry: str | None = None  # which camera of a calibration with several, such as cam1
    distortion: str | None = None  # of OpenCV's files that do not say: radtan (pinhole) or equidistant (fisheye)
    panorama: Panorama | None = None  # equirectangular or strip: the images are panoramas, their middle is the front
    circle_px: list[float] | None = setting(
        None, at_least=-1e6, at_most=1e6
    )  # cx, cy, radius and, if need be, inner radius in the images; null: found
    sky_inside: bool = False  # the horizon is crossed inwards: the sky is at the centre
    blank_outside: bool = False  # set what lies off the circle's ring to 0
    mask: str | None = None  # an image of the same size: where it is dark, all images are set to 0
    mirrored: bool = False  # azimuth runs clockwise in the images
    turned_deg: float = setting(
        0.0, at_least=-1e6, at_most=1e6
    )  # azimuth in the picture, once flipped, of the direction that headings speak of
    color: bool = False  # RGB instead of grey
    on_bad_image: OnBadImage = OnBadImage.fail  # or skip
    batch: int = setting(64, at_least=1, at_most=4096)  # images handed over at a time, fewer where they are large

    def __post_init__(self) -> None:
        check_settings(self)
        if self.to_s is not None and self.to_s <= self.from_s:
            raise ConfigError(f"to_s={self.to_s:g} is not after from_s={self.from_s:g}; give a later time, or null")
        for name in ("entry", "distortion"):
            if self.camera is None and getattr(self, name) is not None:
                raise ConfigError(f"{name}={getattr(self, name)!r} is given without a camera; give sensor.camera=FILE")
        if self.circle_px is not None:
            check_circle(self.circle_px)
        if self.panorama is not None:
            self.panorama = panorama_kind(self.panorama)

    def open_stream(self) -> ImageStream:
        """The recording; DataError, in one sentence, if it holds no images that can be played back."""
        raise NotImplementedError

    def plan(self, layout: PoseRequest) -> Plan:
        """The images from `from_s` to `to_s`, each `every` of them, in their order; those without a pose are left out."""
        if layout != RecordedPoses():
            raise DataError(
                f"{self.stream.name} is a sequence of {len(self.stream.stamps_ns)} images, of which all or each n-th"
                " (sensor.every) are taken, and no others; ask for all that was recorded, as study.places=recorded and"
                " experiment=recorded_trajectory do, or convert it to a folder (omnilab convert) and give grid columns there"
            )
        rows, source = self._rows(), self.source
        self._remark_log.warn(self.stream.remarks)
        if source is None:
            return Plan(self._names(rows), None)
        T, known = source.at(self.stream.stamps_ns[rows], self.tolerance_s)
        omitted = self._without_pose(rows[~known])
        R_robot_camera = rotation_xyz(0, 0, -math.radians(self.turned_deg))
        T[:, :3, :3] = T[:, :3, :3] @ R_robot_camera
        return Plan(self._names(rows[known]), T[known], omitted)

    def frames(self, plan: Plan) -> Iterator[Frames]:
        """The planned images, `batch` at a time; DataError if none of them can be read."""
        self._remark_log.warn(self.remarks)
        rows = self._rows_of(plan.keys)
        loaded: list[tuple[int, str, Bytes]] = []
        omitted: list[str] = []
        for index, picture in enumerate(self.stream.pictures(rows)):
            name = plan.keys[index]
            try:
                image = self._prepared(picture, name)
            except DataError as error:
                omitted.append(self._left_out(error))
                continue
            if len(loaded) == min(self.batch, self._at_a_time):
                yield self._packed(plan, rows, loaded, omitted)
                loaded, omitted = [], []
            loaded.append((index, *image))
        if loaded:
            yield self._packed(plan, rows, loaded, omitted)
        elif omitted:
            raise DataError(f"none of the {len(plan)} images can be read, and {omitted[0]}")

    def scene(self) -> Mesh | None:
        """None: nothing is known of the world but its images."""
        return None

    @cached_property
    def stream(self) -> ImageStream:
        """The recording, opened when it is needed."""
        return self.open_stream()

    def __getstate__(self) -> dict[str, Any]:
        """Settings alone: another process opens the recording anew."""
        own = type(self).__dataclass_fields__
        return {name: value for name, value in vars(self).items() if name in own}

    # ---------------------------------------------------------------------------------------------------------- images
    def _rows(self) -> Ints:
        stamps = self.stream.stamps_ns
        since_s = (stamps - stamps[0]) / SECOND_NS
        taken = since_s >= self.from_s
        if self.to_s is not None:
            taken &= since_s <= self.to_s
        if not taken.any():
            raise DataError(
                f"{self.stream.name} has no image from {self.from_s:g} s to {self.to_s or math.inf:g} s, it is"
                f" {since_s.max():.3f} s long; give other sensor.from_s and sensor.to_s"
            )
        return np.flatnonzero(taken)[:: self.every]

    def _names(self, rows: Ints) -> list[str]:
        return [image_name(self.stream.name, row) for row in rows.tolist()]

    def _rows_of(self, names: Sequence[str]) -> Ints:
        """The rows of planned images."""
        return np.array([int(name.rpartition("#")[2]) for name in names], np.int64)

    def _prepared(self, picture: Bytes | str, name: str) -> tuple[str, Bytes]:
        """Key and pixels of an image as they are handed over; DataError if there are none, or they have another size."""
        if isinstance(picture, str):
            raise DataError(picture)
        check_size(picture.shape[:2], self.optics.unseen.shape, name)
        pixels = self._in_color(picture)
        key = self.optics.key(name, pixels.tobytes())
        return key, self.optics.prepared(pixels)

    def _in_color(self, picture: Bytes) -> Bytes:
        wanted = to_color(picture[None]) if self.color and picture.ndim == 2 else picture[None]
        return np.asarray((wanted if self.color else to_gray(wanted))[0], np.uint8)

    @property
    def _at_a_time(self) -> int:
        """How many pictures are no more than MOST_BYTES."""
        return max(1, MOST_BYTES // ((3 if self.color else 1) * self.optics.unseen.size))

    def _left_out(self, error: DataError) -> str:
        if self.on_bad_image is OnBadImage.skip:
            return str(error)
        raise DataError(f"{error}; leave such images out with sensor.on_bad_image=skip") from error

    def _packed(self, plan: Plan, rows: Ints, loaded: Sequence[tuple[int, str, Bytes]], omitted: list[str]) -> Frames:
        indices, keys, pictures = zip(*loaded, strict=True)
        return Frames(
            images=np.stack(pictures),
            keys=list(keys),
            stamps_ns=self.stream.stamps_ns[rows[list(indices)]],
            camera=self.optics.camera,
            plan_index=np.array(indices),
            T_world_camera=plan.at(indices).T_world_camera,
            omitted=omitted,
        )

    # ---------------------------------------------------------------------------------------------------------- camera
    @cached_property
    def optics(self) -> Optics:
        """The camera, and what becomes of the pixels of an image."""
        camera = self._camera()
        unseen = blanked(camera, Path(), self.mask, self.blank_outside)
        return Optics(camera.flipped() if self.mirrored else camera, unseen, self.mirrored, Decoder(self.color), False)

    def _camera(self) -> RayCamera | ImageCircle:
        """Camera of the images as they are: as the settings say or, where they do not, the recording."""
        own, sample = self.stream.camera, most_alike(self.sample)
        if own is None or not self.camera_choice.is_open:
            return self.camera_choice.camera(Path(), sample)
        height, width = sample[0].shape
        if (own.height, own.width) != (height, width):
            raise DataError(
                f"{self.stream.name} has a camera of images of {own.width} x {own.height} pixels, and images of {width} x"
                f" {height}; give the calibration that was made at their size, sensor.camera=FILE"
            )
        return own

    @property
    def camera_choice(self) -> CameraChoice:
        """What the settings say of the camera."""
        file = None if self.camera is None else CameraFile(self.camera, self.looks, self.entry, self.distortion)
        return CameraChoice(file, self.panorama, self.circle_px, self.sky_inside)

    @cached_property
    def sample(self) -> dict[str, DecodedImage]:
        """Some images from all over what is played back, by name, in grey; large ones are reduced."""
        rows = self._rows()
        rows = rows[np.unique(np.linspace(0, len(rows) - 1, SAMPLE).astype(int))]
        sample, bad = {}, []
        for name, picture in zip(self._names(rows), self.stream.pictures(rows), strict=True):
            if isinstance(picture, str):
                bad.append(self._left_out(DataError(picture)))
                continue
            pixels = to_gray(picture[None])[0]
            shape = (pixels.shape[0], pixels.shape[1])
            header = ImageHeader("stream", width=shape[1], height=shape[0])
            sample[name] = DecodedImage(pixels, header, shape).reduced()
        if not sample:
            raise DataError(f"of {self.stream.name} none of the images looked at can be read: {bad[0]}")
        return sample

    @cached_property
    def remarks(self) -> dict[str, str]:
        """What a user should know of how the recording is read, a sentence a topic, as far as a sample shows it."""
        return dict(self.stream.remarks) | self.camera_choice.remarks(self.optics.camera, most_alike(self.sample))

    @cached_property
    def _remark_log(self) -> RemarkLog:
        return RemarkLog(self.path)

    # ----------------------------------------------------------------------------------------------------------- poses
    @cached_property
    def source(self) -> PoseSource | None:
        """The poses, on the images' clock; None where there are none."""
        own = self.stream.poses
        if self.positions is not None:
            found = poses_of_file(self.positions)
        elif own is not None and own.stamps_ns is not None:
            found = source_of(own, own.stamps_ns, f"the poses of {self.stream.name}")
        elif self.estimate_offset or self.clock_offset_s:
            raise ConfigError("a clock's offset is given or to be estimated, but no poses; give sensor.positions=FILE")
        else:
            return None
        found = found.shifted(self.clock_offset_s)
        if not self.estimate_offset:
            return found
        rows, turns = self._seen_turns()
        offset_s, correlation = estimate_offset(turns, self.stream.stamps_ns[rows], found)
        total = self.clock_offset_s + offset_s
        log.info(
            "%s: the times in %s are moved by %.3f s, where turns of images and of poses agree best (correlation %.2f):"
            " sensor.clock_offset_s=%.3f does the same",
            self.path, found.of, total, correlation, total,
        )  # fmt: skip
        return found.shifted(offset_s)

    def _seen_turns(self) -> tuple[Ints, Floats]:
        """Rows (N,) of some images, and by how much (N - 1,) each is turned from the one before."""
        rows = self._rows()
        rows = rows[:: -(-len(rows) // TURNS)]
        seen, panoramas = [], []
        for row, picture in zip(rows.tolist(), self.stream.pictures(rows), strict=True):
            if not isinstance(picture, str) and picture.shape[:2] == self.optics.unseen.shape:
                image = self.optics.prepared(to_gray(picture[None])[0])
                panoramas.append(panorama(image[None], self.optics.camera, TURN_SHAPE)[0])
                seen.append(row)
        turns = [turn_between(before, now) for before, now in pairwise(panoramas)]
        return np.array(seen, np.int64), wrap_angle(turns)

    def _without_pose(self, rows: Ints) -> list[str]:
        """Why images have no pose, one sentence each; their number is logged."""
        if not len(rows) or self.source is None:
            return []
        why = self.source.left_out(self.tolerance_s)
        since_s = (self.stream.stamps_ns[rows] - self.stream.stamps_ns[0]) / SECOND_NS
        self._remark_log.warn({
            "poses": f"{len(rows)} of {len(self._rows())} images have no pose and are left out: that at {since_s[0]:.3f} s {why}"
        })  # fmt: skip
        return [f"{name} {why}" for name in self._names(rows)]
