"""Calibration beside the images: a camera written by `omnilab.cameras.save_camera`, or OCamCalib's."""

from __future__ import annotations

from pathlib import Path

from omnilab.cameras import OCamCamera, RayCamera, load_camera
from omnilab.errors import ConfigError, DataError
from omnilab_recordings.images.files import existing

CAMERA_FILE = "camera.json"


def read_camera(folder: Path, name: str | None, looks: str | None) -> tuple[Path, RayCamera] | None:
    """The file that describes the camera of a folder, and the camera; without a name camera.json, if it is there."""
    file = existing(folder / (name or CAMERA_FILE))
    if name is None and not file.is_file():
        if looks is not None:
            raise ConfigError(f"looks={looks!r} is given without a camera; give sensor.camera=FILE, or leave it out")
        return None
    if file.suffix.lower() == ".txt":
        return file, OCamCamera.from_file(file, looks=looks or "down")
    if looks is not None:
        raise ConfigError(f"looks={looks!r} is given, but {file} says itself where its camera looks; leave looks out")
    return file, load_camera(file)


def check_frame_of(file: Path, camera: RayCamera, shape: tuple[int, ...]) -> None:
    """DataError if a camera is not of images (H, W)."""
    if (camera.height, camera.width) != shape:
        raise DataError(
            f"{file} is of images of {camera.width} x {camera.height} pixels, these have {shape[1]} x {shape[0]};"
            " give the calibration that was made at their size"
        )
