"""Which camera pictures are of: that of a file, the kind of panorama that is declared, or the circle that they show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from omnilab.api import Bools, Camera
from omnilab.cameras import ImageCircle, RayCamera
from omnilab.errors import ConfigError, DataError
from omnilab_recordings.calibration import CameraFile, check_frame_of
from omnilab_recordings.images.circle import inscribed
from omnilab_recordings.images.decoding import DecodedImage
from omnilab_recordings.optics import circle_of, off_ring, unseen_in
from omnilab_recordings.panoramas import PLURALS, WIDE, Panorama, declared_camera, doubt, proposal

NEARLY_SQUARE = 0.02
GUESSED = (
    "no dark surround shows where the mirror is, and the circle inscribed in the frame is a guess: give"
    " sensor.circle_px=[cx,cy,radius]"
)


@dataclass(frozen=True)
class CameraChoice:
    """What a sensor's settings say of its camera, and what pictures of one size (a sample of them) then are of."""

    file: CameraFile | None  # None: there is none, whatever lies in the folder
    panorama: Panorama | None = None
    circle_px: Sequence[float] | None = None
    sky_inside: bool = False
    preset: Panorama | None = None  # of the published set that the names are of
    names: str | None = None  # that set

    @property
    def is_open(self) -> bool:
        """Whether the settings say nothing of the camera."""
        return self.file is None and self.panorama is None and self.circle_px is None and not self.sky_inside

    def camera(self, folder: Path, sample: Sequence[DecodedImage]) -> RayCamera | ImageCircle:
        """Camera of the pictures as they are: as calibrated or declared or, without a calibration, the circle."""
        height, width = sample[0].shape
        calibrated = None if self.file is None else self.file.read(folder, (width, height))
        if calibrated is not None:
            file, camera = calibrated
            if self.panorama is not None:
                raise ConfigError(
                    f"panorama={self.panorama.value} is given, but {file} says what camera it is; leave one of them out"
                )
            self._check_no_circle(f"the camera in {file} knows its circle and its horizon")
            check_frame_of(file, camera, (height, width))
            return camera
        if self.panorama is not None:
            self._check_no_circle(f"panorama={self.panorama.value} has no circle and knows its horizon")
        if (kind := self._declared(sample)) is not None:
            return declared_camera(kind, width, height)
        try:
            return ImageCircle(width, height, circle_of(self.circle_px, sample), self.sky_inside)
        except DataError as error:
            other = proposal(sample, given=self.circle_px is not None)
            raise DataError(str(error) if other is None else f"{error}; or, as {other}") from error

    def _declared(self, sample: Sequence[DecodedImage]) -> Panorama | None:
        """The kind of panorama that the pictures are said to be, by the setting or by the preset of their names."""
        preset, (height, width) = self.preset, sample[0].shape
        if self.panorama is not None or self.circle_px is not None or self.sky_inside or preset is None:
            return self.panorama
        return preset if width >= WIDE * height else None

    def _check_no_circle(self, reason: str) -> None:
        if self.circle_px is not None or self.sky_inside:
            raise ConfigError(
                f"circle_px or sky_inside is given, but {reason};"
                " leave them out (a rim is rim_px in a camera's file), or the file or panorama"
            )

    def remarks(self, camera: Camera, sample: Sequence[DecodedImage]) -> dict[str, str]:
        """What a user should know of the camera that was chosen, a sentence a topic."""
        panorama = self._about_panorama(camera, sample)
        if panorama is not None:
            return {"panorama": panorama}
        return {"circle": GUESSED} if self.is_doubtful(camera) else {}

    def is_guess(self, camera: Camera) -> bool:
        """Whether the circle is but the one inscribed in the frame, as nothing tells where it is."""
        return self.circle_px is None and camera.circle == inscribed((camera.height, camera.width))

    def is_doubtful(self, camera: Camera) -> bool:
        """Whether the circle is a guess for pictures that are not square, as the frame of a mirror's circle may well be."""
        return self.is_guess(camera) and abs(camera.width / camera.height - 1) > NEARLY_SQUARE

    def _about_panorama(self, camera: Camera, sample: Sequence[DecodedImage]) -> str | None:
        """Panoramas that are taken for mirror pictures, and mirror pictures that are declared to be panoramas."""
        if isinstance(camera, ImageCircle):
            if self.preset is not None and camera.width < WIDE * camera.height:
                return (
                    f"the set names={self.names} is of {PLURALS[self.preset]} as published, but the pictures are"
                    f" {camera.width} x {camera.height} pixels: they are taken for mirror pictures"
                )
            circle = None if self.is_guess(camera) else camera.circle
            return proposal(sample, circle, given=self.circle_px is not None)
        kind = self._declared(sample)
        if kind in {None, Panorama.dual_fisheye} or (sentence := doubt(sample)) is None:
            return None
        return f"{sentence} sensor.panorama" if self.panorama else f"{sentence} sensor.names={self.names}"


def blanked(camera: Camera, folder: Path, mask: str | None, blank_outside: bool) -> Bools:
    """Pixels (H, W) of a camera's pictures that are set to 0: where a mask below the folder is dark, and off the ring."""
    shape = (camera.height, camera.width)
    unseen = np.zeros(shape, bool) if mask is None else unseen_in(folder, mask, shape)
    if blank_outside:
        unseen |= off_ring(camera.circle, shape)
    return unseen
