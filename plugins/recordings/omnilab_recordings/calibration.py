"""Calibration beside the images: camera.json, or a file of a calibration tool."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

from omnilab.cameras import RayCamera, load_camera
from omnilab.errors import ConfigError, DataError
from omnilab_recordings.images.files import existing

CAMERA_FILE = "camera.json"


@dataclass(frozen=True)
class CameraFile:
    """Which file describes the camera of a folder, and what that file may leave open (`omnilab.cameras.load_camera`)."""

    name: str | None  # below the folder, or any path; None: camera.json, if it is there
    looks: str | None = None
    entry: str | None = None
    distortion: str | None = None

    def read(self, folder: Path, size: tuple[int, int] | None = None) -> tuple[Path, RayCamera] | None:
        """The file and the camera, for images of a size (width, height) if the file does not say; None without a file."""
        file = existing(folder / (self.name or CAMERA_FILE))
        open_ = {key: value for key, value in asdict(self).items() if key != "name"}
        if self.name is None and not file.is_file():
            for key, value in open_.items():
                if value is not None:
                    raise ConfigError(
                        f"{key}={value!r} is given without a camera; give sensor.camera=FILE, or leave it out"
                    )
            return None
        return file, load_camera(file, size=size, **open_)


def check_frame_of(file: Path, camera: RayCamera, shape: tuple[int, ...]) -> None:
    """DataError if a camera is not of images (H, W)."""
    if (camera.height, camera.width) != shape:
        turned = (
            "; the pictures, or the numbers, are turned by 90 degrees" if shape == (camera.width, camera.height) else ""
        )
        raise DataError(
            f"{file} is of images of {camera.width} x {camera.height} pixels, these have {shape[1]} x {shape[0]}{turned};"
            " give the calibration that was made at their size"
        )
