"""Files of cameras: omnilab's own, so that pictures can travel with their camera, and those of calibration tools."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from dataclasses import asdict
from functools import cache, partial
from pathlib import Path
from typing import Any

from omnilab.atomic_files import write_whole
from omnilab.cameras.base import RayCamera
from omnilab.cameras.formats import camodocal, kalibr, opencv, pyocamcalib
from omnilab.cameras.formats.camera_json import MODELS, camera_of
from omnilab.cameras.formats.entry import CameraParameters, Entry, Size
from omnilab.cameras.formats.safe_yaml import load_yaml
from omnilab.cameras.formats.unread import READ, known_file, known_keys, known_text
from omnilab.cameras.ocam import OCamCamera
from omnilab.cameras.plausibility import check_sees
from omnilab.errors import ConfigError, DataError
from omnilab.file_kinds import content_of

LARGEST_FILE = 2**20  # bytes
DISTORTIONS = ("radtan", "equidistant")

log = logging.getLogger("omnilab")


def save_camera(camera: RayCamera, path: Path | str) -> None:
    """Write a camera's model and settings; ConfigError for a camera of a model that is not in `MODELS`."""
    name = type(camera).__name__
    if MODELS.get(name) is not type(camera):
        raise ConfigError(f"a {name} cannot be written to {path}; a file can hold one of {', '.join(sorted(MODELS))}")
    settings = asdict(camera)  # type: ignore[call-overload]  # cameras are frozen dataclasses
    text = json.dumps({"model": name, **settings}, indent=1) + "\n"
    write_whole(Path(path), lambda out: out.write(text.encode()))


def load_camera(
    path: Path | str,
    looks: str | None = None,
    entry: str | None = None,
    distortion: str | None = None,
    size: Size | None = None,
) -> RayCamera:
    """The camera in a file of `save_camera`, Kalibr, OpenCV, ROS, Camodocal (KITTI-360), OCamCalib or py-OCamCalib.

    What such a file leaves open is given here: where the camera `looks` (down, up or ahead; None: as its model does by
    default), which `entry` of several cameras is meant, of which model four coefficients of OpenCV are (`distortion`:
    radtan or equidistant), and the `size` (width, height) of the images. DataError that names what is missing, unknown
    or wrong in the file, or what it is instead; ConfigError for what must be given here, or is given and does not fit.
    """
    path = Path(path)
    if distortion is not None and distortion not in DISTORTIONS:
        raise ConfigError(f"distortion={distortion!r} is not known; give {' or '.join(DISTORTIONS)}, or leave it out")
    text = _read_text(path)
    if _is_ocamcalib(path, text):
        _refuse(path, entry=entry, distortion=distortion)
        return _sound(path, OCamCamera.from_file(path, looks or "down"))
    found = _parsed(path, text)
    if "model" in found:
        _refuse(path, looks=looks, entry=entry, distortion=distortion)
        return _sound(path, camera_of(path, found))
    calibration = _calibration(path, found, entry, distortion)
    for key in calibration.unused:
        _say_once(f"{path} has {key}, which is not used: where the camera was is said by the poses of its pictures")
    return _sound(path, _with_frame(path, calibration, looks, size))


def camera_of_info(path: Path, found: Mapping[str, Any], looks: str | None) -> RayCamera:
    """The camera that values describe as they stand in such a file; `path` names them in errors, which are those of `load_camera`."""
    if "model" in found:
        return _sound(path, camera_of(path, found))
    return _sound(path, _with_frame(path, _calibration(path, found, None, None), looks, None))


def _calibration(path: Path, found: Mapping[str, Any], entry: str | None, distortion: str | None) -> CameraParameters:
    """What the first tool makes of a file that knows it as its own."""
    with_question = partial(opencv.calibration, distortion=distortion)
    for tool, read in (
        (kalibr, kalibr.calibration), (camodocal, camodocal.calibration), (pyocamcalib, pyocamcalib.calibration),
        (opencv, with_question),
    ):  # fmt: skip
        if cameras := tool.entries(found):
            if distortion is not None and read is not with_question:
                _refuse(path, distortion=distortion)
            return read(_chosen(path, cameras, entry))
    raise DataError(f"{path} {known_keys(found)}")


def _chosen(path: Path, cameras: Mapping[str, Any], entry: str | None) -> Entry:
    """The camera of that name; ConfigError if there are several and none is named, or none of that name."""
    if "" in cameras:
        _refuse(path, entry=entry)
    if entry is None and len(cameras) == 1:
        entry = next(iter(cameras))
    if entry is None or entry not in cameras:
        unknown = "" if entry is None else f", and no {entry}"
        ways = " or ".join(f"entry={name}" for name in cameras)
        raise ConfigError(
            f"{path} describes {len(cameras)} camera(s), {', '.join(cameras)}{unknown}; give {ways}"
            f" (sensor.entry={next(iter(cameras))} in a run, --entry of omnilab check)"
        )
    return Entry(path, entry, cameras[entry])


def _with_frame(path: Path, calibration: CameraParameters, looks: str | None, size: Size | None) -> RayCamera:
    """The camera that a calibration is of, its size and where it looks filled in."""
    if calibration.size is None and size is None:
        raise ConfigError(f"{path} does not say of which size its images are; give sensor.size_px=[WIDTH,HEIGHT]")
    width, height = calibration.size or size or (0, 0)
    given: dict[str, Any] = {} if looks is None else {"looks": looks}
    try:
        return calibration.model(width=width, height=height, **given, **calibration.settings)
    except ConfigError as error:
        raise DataError(f"{path}: {error}") from None


def _sound(path: Path, camera: RayCamera) -> RayCamera:
    try:
        check_sees(camera)
    except ConfigError as error:
        raise DataError(f"{path}: {error}") from None
    return camera


def _refuse(path: Path, **given: str | None) -> None:
    """ConfigError for what is given and can be meant of no file like this one."""
    for name, value in given.items():
        if value is not None:
            what = "says itself where its camera looks" if name == "looks" else "leaves no such thing open"
            raise ConfigError(f"{name}={value!r} is given, but {path} {what}; leave {name} out")


@cache
def _say_once(sentence: str) -> None:
    log.warning("%s", sentence)


# ------------------------------------------------------------------------------------------------------- text to values
def _read_text(path: Path) -> str:
    """A file of bounded size; DataError if it cannot be read, or is known to be something else."""
    try:
        if known := known_file(path):
            raise DataError(f"{path} {known}")
        data = content_of(path, LARGEST_FILE)
    except OSError as error:
        raise DataError(f"{path} cannot be read ({error.strerror}); give a file that describes a camera") from None
    text = data.decode("utf-8-sig", errors="replace")
    if known := known_text(text):
        raise DataError(f"{path} {known}")
    return text


def _is_ocamcalib(path: Path, text: str) -> bool:
    comments = [line for line in text.splitlines() if line.startswith("#")]
    return path.suffix.lower() == ".txt" or any("polynomial coefficients" in line.lower() for line in comments)


def _parsed(path: Path, text: str) -> Mapping[str, Any]:
    """The mapping in a JSON or YAML file."""
    if path.suffix.lower() == ".json" or text.lstrip()[:1] in {"{", "["}:
        try:
            found = json.loads(text, object_pairs_hook=partial(_unique, path))
        except json.JSONDecodeError as error:
            raise DataError(f"{path} is not JSON (line {error.lineno}, column {error.colno}); give {READ}") from None
        except (ValueError, RecursionError):
            raise DataError(f"{path} is not JSON that is read; give {READ}") from None
    else:
        found = load_yaml(path, text)
    if not isinstance(found, Mapping):
        raise DataError(f"{path} holds a {type(found).__name__} and no camera; give {READ}")
    return found


def _unique(path: Path, pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise DataError(f"{path} has the key '{key[:40]}' twice; remove one")
        found[key] = value
    return found
