"""Sensor `folder`: omnidirectional images in a folder, with or without poses."""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property, partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from omnilab.api import Bytes, Floats, Frames, Ints, Mesh, Plan, PoseRequest, check_settings, setting
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import poses, rotation_xyz
from omnilab_recordings import remarks
from omnilab_recordings.calibration import CameraFile
from omnilab_recordings.camera_choice import CameraChoice, blanked
from omnilab_recordings.images.decoding import DecodedImage, Decoder
from omnilab_recordings.images.depth import read_depth
from omnilab_recordings.images.files import existing, read_bytes
from omnilab_recordings.on_bad_image import OnBadImage
from omnilab_recordings.optics import Optics, check_circle, most_alike
from omnilab_recordings.panoramas import Panorama, panorama_kind
from omnilab_recordings.poses.filename_poses import Naming, naming
from omnilab_recordings.questions import questions
from omnilab_recordings.recording import POSITIONS_FILE, Recording, open_recording
from omnilab_recordings.remarks import RemarkLog

R = TypeVar("R")
log = logging.getLogger("omnilab")

SAMPLE = 16  # images by which the size and the circle of all are found
AHEAD = 16  # images that are read in advance
MOST_BYTES = 2**28  # of pictures that are handed over at a time, and that are read in advance


class HeadingSense(Enum):
    """Which way yaw_deg and yaw_rad run, seen from above."""

    counterclockwise = "counterclockwise"
    clockwise = "clockwise"


@dataclass(frozen=True)
class _LoadedImage:
    index: int  # in the plan
    key: str
    picture: Bytes
    depth_m: Floats | None
    remarks: Mapping[str, str]


@dataclass
class Folder:
    """A folder of omnidirectional images; a CSV or their names say where each was taken (formats: README of the plugin).

    Grids take the recorded columns and rows (`every`, `step_m`), and `RecordedPoses(without=...)` the other images;
    there are no other poses. Without positions there is only `RecordedPoses()`.

    `mirrored` pictures are flipped left to right first of all. Then `turned_deg` is the azimuth in the picture of the
    direction that `yaw_deg` refers to (the robot's front, say). Nothing is resampled: image right looks to
    `yaw_deg - turned_deg`, and that is the heading of the pose.

    `camera` (below the folder, or any path) is calibrated on the files as they are: where pictures are flipped, so is
    the camera. Without one the pictures have but a circle, and panoramas are spaced evenly in radius. Keys are
    `file@digest` of the content and of the settings that change the pixels.
    """

    path: str = "???"  # of the folder
    positions: str | None = POSITIONS_FILE  # below the folder: a CSV, or a trajectory (.txt, .tum); null: none
    pattern: str = "**/*"  # which images below the folder belong to the recording
    names: str | None = None  # poses by names instead: a regular expression with named groups, or a preset's name
    spacing_m: float | None = setting(None, above=0)  # with names: between columns and rows; null: the preset's
    columns: int | None = setting(None, at_least=1)  # with names that only count: images in a row; null: the preset's
    lowest_m: float | None = setting(
        None, at_least=-1e6, at_most=1e6
    )  # with names that count levels: height of the lowest; null: the preset's, or 0
    height_step_m: float | None = setting(
        None, above=0
    )  # with names that count levels: between two; null: the preset's
    headings: HeadingSense | None = None  # which way yaw_deg runs; null: counterclockwise, compared with the pictures
    camera: str | None = None  # its calibration (formats: docs/cameras.md); null: camera.json, if there
    looks: str | None = None  # where the file leaves it open: down, up or ahead; null: ahead of pinholes, else down
    entry: str | None = None  # which camera of a calibration with several, such as cam1
    distortion: str | None = None  # of OpenCV's files that do not say: radtan (pinhole) or equidistant (fisheye)
    panorama: Panorama | None = (
        None  # equirectangular or strip: the files are panoramas, their middle is the front; null: the preset's
    )
    circle_px: list[float] | None = setting(
        None, at_least=-1e6, at_most=1e6
    )  # cx, cy, radius and, if need be, inner radius in the files; null: found
    sky_inside: bool = False  # the horizon is crossed inwards: the sky is at the centre
    blank_outside: bool = False  # set what lies off the circle's ring to 0
    mask: str | None = None  # image of the same size, below the folder: where it is dark, all images are set to 0
    mirrored: bool = False  # azimuth runs clockwise in the files
    turned_deg: float = setting(
        0.0, at_least=-1e6, at_most=1e6
    )  # azimuth in the picture, once flipped, of the direction that yaw_deg speaks of
    color: bool = False  # RGB instead of grey
    exif_orientation: bool = True  # turn pictures as their EXIF tags say, as viewers do; or take the pixels as stored
    bits: int | None = setting(
        None, at_least=8, at_most=16
    )  # that files of 16 bits a sample use, such as 12; null: as they declare, or all
    depth: bool = False  # also the depth of a rendered data set: depth/NAME.npy for images/NAME.png
    on_bad_image: OnBadImage = OnBadImage.fail  # or skip
    batch: int = setting(64, at_least=1, at_most=4096)  # images handed over at a time, fewer where they are large

    def __post_init__(self) -> None:
        check_settings(self)
        if not self.pattern or Path(self.pattern).is_absolute() or ".." in Path(self.pattern).parts:
            raise ConfigError(f"pattern={self.pattern!r} does not stay below the folder; give one such as **/*.png")
        if self.circle_px is not None:
            check_circle(self.circle_px)
        if self.panorama is not None:
            self.panorama = panorama_kind(self.panorama)
        self._naming()

    def plan(self, layout: PoseRequest) -> Plan:
        """The images that a layout takes, in the order of the positions file (without one: of their names)."""
        rows = self.recording.rows(layout)
        for question in self._questions:
            log.warning(question)
        return self.plan_of(rows)

    def plan_of(self, rows: Ints) -> Plan:
        """The images in some rows (n,) of the recording."""
        return Plan([self.recording.images[row] for row in rows], self._poses(rows))

    def frames(self, plan: Plan) -> Iterator[Frames]:
        """The planned images, `batch` at a time; DataError if none of them can be read."""
        self._remark_log.warn(self.remarks)
        loaded: list[_LoadedImage] = []
        omitted: list[str] = []
        for image in self._images(plan.keys):
            if isinstance(image, str):
                omitted.append(image)
                continue
            self._remark_log.warn(remarks.of_files({plan.keys[image.index]: image.remarks}))
            if len(loaded) == min(self.batch, self._at_a_time):
                yield self._packed(plan, loaded, omitted)
                loaded, omitted = [], []
            loaded.append(image)
        if loaded:
            yield self._packed(plan, loaded, omitted)
        elif omitted:
            raise DataError(f"none of the {len(plan)} images can be read, and {omitted[0]}; replace the files")

    def scene(self) -> Mesh | None:
        """None: nothing is known of the world but its images."""
        return None

    def _poses(self, rows: Ints) -> Floats | None:
        positions = self.recording.positions
        if positions is None:
            return None
        R_robot_camera = rotation_xyz(0, 0, -math.radians(self.turned_deg))
        return poses(positions.position_m[rows], positions.R_world_robot[rows] @ R_robot_camera)

    def _images(self, names: Sequence[str]) -> Iterator[_LoadedImage | str]:
        """Each image, or why it is left out."""
        read = partial(_read, self.root, self.optics, self.depth)
        with ThreadPoolExecutor(2) as pool:
            for index, reading in enumerate(_ahead(pool, read, names, min(AHEAD, self._at_a_time))):
                try:
                    yield _LoadedImage(index, *reading.result())
                except DataError as error:
                    yield self._left_out(error)

    @property
    def _at_a_time(self) -> int:
        """How many pictures are no more than MOST_BYTES."""
        samples = (3 if self.color else 1) + (4 if self.depth else 0)
        return max(1, MOST_BYTES // (samples * self.optics.unseen.size))

    def _left_out(self, error: DataError) -> str:
        if self.on_bad_image is OnBadImage.skip:
            return str(error)
        raise DataError(f"{error}; replace it, or leave such files out with sensor.on_bad_image=skip") from error

    def _packed(self, plan: Plan, loaded: Sequence[_LoadedImage], omitted: Sequence[str]) -> Frames:
        chosen = plan.at(image.index for image in loaded)
        return Frames(
            images=np.stack([image.picture for image in loaded]),
            keys=[image.key for image in loaded],
            stamps_ns=self.recording.stamps_ns(chosen.keys),
            camera=self.optics.camera,
            plan_index=np.array([image.index for image in loaded]),
            T_world_camera=chosen.T_world_camera,
            omitted=omitted,
            depth_m=np.stack([image.depth_m for image in loaded if image.depth_m is not None]) if self.depth else None,
        )

    @cached_property
    def root(self) -> Path:
        """The folder, by its name on disk."""
        return existing(Path(self.path))

    @cached_property
    def recording(self) -> Recording:
        """The images and their poses."""
        aside = [self.mask] if self.mask else []
        found = open_recording(self.root, self.positions, self.pattern, aside, self._naming())
        if self.headings is not HeadingSense.clockwise or found.positions is None:
            return found
        return replace(found, positions=found.positions.clockwise())

    @cached_property
    def _questions(self) -> list[str]:
        return questions(self)

    def _naming(self) -> Naming | None:
        given = {
            "spacing_m": self.spacing_m,
            "columns": self.columns,
            "lowest_m": self.lowest_m,
            "height_step_m": self.height_step_m,
        }
        if self.names is not None:
            return naming(self.names, **given)
        for name, value in given.items():
            if value is not None:
                raise ConfigError(f"{name}={value} is of no use without names; give sensor.names, or leave it out")
        return None

    @cached_property
    def optics(self) -> Optics:
        """The camera, and what becomes of the pixels of a file."""
        sample = most_alike(self.sample)
        camera = self.camera_choice.camera(self.root, sample)
        unseen = blanked(camera, self.root, self.mask, self.blank_outside)
        decoder = Decoder(self.color, self.exif_orientation, self.bits)
        return Optics(camera.flipped() if self.mirrored else camera, unseen, self.mirrored, decoder, sample[0].deep)

    @property
    def camera_choice(self) -> CameraChoice:
        """What the settings say of the camera."""
        preset = found.panorama if (found := self._naming()) else None
        return CameraChoice(self.camera_file, self.panorama, self.circle_px, self.sky_inside, preset, self.names)

    @property
    def camera_file(self) -> CameraFile:
        """The file that describes the camera."""
        return CameraFile(self.camera, self.looks, self.entry, self.distortion)

    @property
    def circle_is_doubtful(self) -> bool:
        """Whether the circle is a guess for pictures that are not square, as the frame of a mirror's circle may well be."""
        return self.camera_choice.is_doubtful(self.optics.camera)

    @property
    def guessed_circle(self) -> bool:
        """Whether the circle is but the one inscribed in the frame, as nothing tells where it is."""
        return self.camera_choice.is_guess(self.optics.camera)

    @cached_property
    def remarks(self) -> dict[str, str]:
        """What a user should know of how the files are read, a sentence a topic, as far as a sample shows it."""
        alike = most_alike(self.sample)
        files = {name: remarks.of_file(image, self.exif_orientation) for name, image in self.sample.items()}
        other = {
            "bits": remarks.of_range(alike, self.bits),
            "depth maps": remarks.of_depths({name: image.deep for name, image in self.sample.items()}),
        }
        known = {topic: text for topic, text in other.items() if text is not None}
        return remarks.of_files(files) | self.camera_choice.remarks(self.optics.camera, alike) | known

    @cached_property
    def _remark_log(self) -> RemarkLog:
        return RemarkLog(self.path)

    @cached_property
    def sample(self) -> dict[str, DecodedImage]:
        """Some images from all over the recording, by name, in grey; large ones are reduced."""
        names = self.recording.images
        decoder = Decoder(exif_orientation=self.exif_orientation, bits=self.bits)
        sample, bad = {}, []
        for at in np.unique(np.linspace(0, len(names) - 1, SAMPLE).astype(int)):
            try:
                sample[names[at]] = decoder.decode(read_bytes(self.root, names[at]), names[at]).reduced()
            except DataError as error:
                bad.append(self._left_out(error))
        if not sample:
            raise DataError(
                f"of the folder {self.path} none of the images looked at can be read: {bad[0]}; replace the files"
            )
        if (
            self.on_bad_image is OnBadImage.fail
            and (mixed := remarks.of_depths({name: image.deep for name, image in sample.items()})) is not None
        ):
            raise DataError(mixed)
        return sample


def _read(folder: Path, optics: Optics, depth: bool, name: str) -> tuple[str, Bytes, Floats | None, Mapping[str, str]]:
    """Key and picture of an image file, its depth if that is wanted, and what is remarkable about it."""
    data = read_bytes(folder, name)
    image = optics.decoder.decode(data, name)
    picture = optics.picture(image, name)
    depth_m = read_depth(folder, name, picture.shape[:2]) if depth else None
    if depth_m is not None and optics.mirrored:
        depth_m = depth_m[:, ::-1]
    return optics.key(name, data), picture, depth_m, remarks.of_file(image, optics.decoder.exif_orientation)


def _ahead(pool: ThreadPoolExecutor, call: Callable[[str], R], items: Iterable[str], count: int) -> Iterator[Future[R]]:
    """The calls of all items in their order, so many of them started in advance."""
    started: deque[Future[R]] = deque()
    for item in items:
        started.append(pool.submit(call, item))
        if len(started) > count:
            yield started.popleft()
    yield from started
