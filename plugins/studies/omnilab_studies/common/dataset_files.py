"""A data set on disk: images, poses, calibration, depth (docs/datasets.md). Files are whole or not there."""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, asdict, dataclass, fields
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from omnilab.api import Bytes, Camera, Floats, Ints, Parts, Plan
from omnilab.atomic_files import PART, is_process, write_whole
from omnilab.cameras import ImageCircle, RayCamera, save_camera
from omnilab.errors import ConfigError, DataError
from omnilab.file_kinds import content_of
from omnilab.geometry import heading_of
from omnilab.limits import check_work
from omnilab.trajectory.columns import MATRIX, POSITION
from omnilab.trajectory.files import tum_text

ABOUT = "dataset.json"
PART_NAME = re.compile(  # of an unfinished file, with its writer
    r"(?:\d{6,}\.(?:png|npy)|dataset\.json|positions\.csv|stamps\.csv|poses\.tum)" + PART
)
LARGEST_IMAGE = 2**28  # bytes of an image file, and pixels in it
PNG, PNG_SIZE = b"\x89PNG\r\n\x1a\n", struct.Struct(">16xII")  # how one begins; its width and height
LARGEST_FILE = 64 * 2**20  # bytes, of dataset.json


@dataclass(frozen=True)
class DataSet:
    """The folder of a data set. Frame n is `images/00000n.png`, and `depth/00000n.npy` where the depth is known."""

    folder: Path
    setting: str = "study.folder"  # that names it

    def image(self, n: int) -> Path:
        """The image file of frame n."""
        return self.folder / "images" / f"{n:06d}.png"

    def depth(self, n: int) -> Path:
        """The depth file of frame n."""
        return self.folder / "depth" / f"{n:06d}.npy"

    def has(self, n: int) -> bool:
        """Whether frame n is there, whole: its image is the last to be written."""
        try:
            return self.image(n).stat().st_size > 0
        except FileNotFoundError:
            return False

    def check_room(self, written: Ints, count: int) -> None:
        """ConfigError if the disk has no room for what is missing of `count` frames, by the size of those written (n,)."""
        missing = count - sum(1 for _ in (self.folder / "images").iterdir())
        sizes = [self.image(n).stat().st_size + self._depth_bytes(n) for n in written.tolist()]
        if sizes and missing > 0:
            disk = missing * sum(sizes) / len(sizes) / 2  # some images are smaller than others
            check_work(f"{missing} images", "give fewer, or a folder with more room", disk=disk, folder=self.folder)

    def _depth_bytes(self, n: int) -> int:
        return self.depth(n).stat().st_size if self.depth(n).exists() else 0

    def open(self, contents: Mapping[str, Any], defaults: Mapping[str, Any] | None = None) -> None:
        """Begin a data set of these contents, or go on with one; DataError if the folder holds anything else.

        `defaults` hold for what a data set does not say that was begun by an earlier version.
        """
        if self.folder.is_file():
            raise DataError(f"{self.setting}={self.folder} is a file; give a new folder")
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            begun = (self.folder / ABOUT).exists()
            if not begun and not all(_is_left_over(path) for path in self.folder.iterdir()):
                raise DataError(f"{self.setting}={self.folder} is neither empty nor a data set; give a new folder")
        except OSError as error:
            raise self._not_written(error) from error
        if begun:
            self._check_same(contents, defaults or {})
            self._remove_parts()
        else:  # before anything else: whatever is in the folder is then known to be of this data set
            self._write_about({**contents, "complete": False})
        try:
            (self.folder / "images").mkdir(exist_ok=True)
        except OSError as error:
            raise self._not_written(error) from error

    def write(self, n: int, pixels: Bytes, depth_m: Floats | None) -> None:
        """Frame n: pixels (H, W[, 3]) and depth (H, W)."""
        if depth_m is not None:
            self.depth(n).parent.mkdir(exist_ok=True)
            stream = io.BytesIO()
            np.save(stream, np.asarray(depth_m, np.float32))
            self._write(self.depth(n), stream.getvalue())
        self._write(self.image(n), _png(pixels))

    def read(self, n: int) -> Bytes:
        """The pixels (H, W[, 3]) of frame n."""
        import cv2

        data = self._png_of(n)
        pixels = None if data is None else cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        if pixels is None:
            raise DataError(f"{self.image(n)} is no whole image; delete it and run this again")
        return np.asarray(pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB), np.uint8)

    def check_same(self, n: int, pixels: Bytes) -> None:
        """DataError if frame n is there, with other pixels than these (H, W[, 3])."""
        if not np.array_equal(self.read(n), pixels):
            raise DataError(
                f"{self.image(n)} is another image than the recording has there; give a new {self.setting}, or delete the image"
            )

    def _png_of(self, n: int) -> bytes | None:
        """The bytes of frame n's image; None for those of no PNG, or of one that would fill the memory."""
        try:
            data = content_of(self.image(n), LARGEST_IMAGE)
        except OSError as error:
            raise DataError(f"{self.image(n)} cannot be read ({error.strerror}); run this again") from error
        if not data.startswith(PNG) or len(data) < PNG_SIZE.size:
            return None
        width, height = PNG_SIZE.unpack_from(data)
        return data if width * height <= LARGEST_IMAGE else None

    def write_camera(self, camera: Camera) -> str:
        """Write `camera.json` where the camera is calibrated; a sentence about what was written."""
        if not isinstance(camera, RayCamera):
            return f"a {type(camera).__name__} is not calibrated, so there is no camera.json"
        try:
            save_camera(camera, self.folder / "camera.json")
        except ConfigError as error:
            return f"there is no camera.json: {error}"
        except OSError as error:
            raise self._not_written(error) from error
        return f"camera.json holds a {type(camera).__name__}"

    def write_poses(self, numbers: Ints, plan: Plan, stamps_ns: Ints, cells: Ints | None) -> None:
        """`positions.csv` and `poses.tum` of frames (n,) of a plan; stamps and cells (N[, 2]) are those of all of it."""
        if plan.T_world_camera is None:
            return
        poses, keys, stamps = plan.T_world_camera[numbers], [plan.keys[n] for n in numbers], stamps_ns[numbers]
        columns: dict[str, Sequence[Any]] = {"image": [f"images/{self.image(n).name}" for n in numbers]}
        columns |= dict(zip(POSITION, poses[:, :3, 3].T.tolist(), strict=True))
        columns["yaw_deg"] = np.rad2deg(heading_of(poses)).tolist()
        columns |= dict(zip(MATRIX, poses[:, :3, :3].reshape(-1, 9).T.tolist(), strict=True))
        columns |= {"stamp_ns": stamps.tolist(), "key": keys}
        if cells is not None:
            columns |= {"ix": cells[numbers, 0].tolist(), "iy": cells[numbers, 1].tolist()}
        self._write(self.folder / "positions.csv", _csv(columns))
        self._write(self.folder / "poses.tum", tum_text(poses, stamps).encode())

    def write_stamps(self, numbers: Ints, stamps_ns: Ints) -> None:
        """`stamps.csv` of frames (n,) without poses; stamps (N,) are those of the whole plan."""
        images = [f"images/{self.image(n).name}" for n in numbers]
        self._write(self.folder / "stamps.csv", _csv({"image": images, "stamp_ns": stamps_ns[numbers].tolist()}))

    def close(self, contents: Mapping[str, Any], found: Mapping[str, Any]) -> None:
        """Mark the data set as complete, and add results."""
        self._write_about({**contents, "complete": True, "omnilab": version("omnilab"), **found})

    def _check_same(self, contents: Mapping[str, Any], defaults: Mapping[str, Any]) -> None:
        try:
            there = json.loads(content_of(self.folder / ABOUT, LARGEST_FILE))
            there = {key: there[key] for key in contents}
        except (ValueError, KeyError, TypeError, RecursionError, OSError) as error:
            lacks = f"it lacks {error.args[0]}" if isinstance(error, KeyError) else "it is no JSON of one"
            reason = error.strerror if isinstance(error, OSError) else lacks
            raise DataError(
                f"{self.folder / ABOUT} describes no data set ({reason}); give a new {self.setting}"
            ) from None
        old, new = dict(_flat(there)), dict(_flat(json.loads(json.dumps(contents, default=str))))
        old |= {key: _class_name(str(old[key])) for key in old if key.rpartition(".")[2] == "class"}
        default = _flat(json.loads(json.dumps(defaults, default=str)))
        old = {key: value for key, value in default if key in new} | old  # it may be older than a setting
        for key in [*old, *new]:
            if old.get(key) != new.get(key):
                raise DataError(
                    f"{self.setting}={self.folder} holds another data set: its {key} is {_short(old.get(key))}, not"
                    f" {_short(new.get(key))};"
                    " give a new folder, or the settings it was begun with"
                )

    def _write_about(self, about: Mapping[str, Any]) -> None:
        self._write(self.folder / ABOUT, (json.dumps(about, indent=1, default=str) + "\n").encode())

    def _write(self, file: Path, data: bytes) -> None:
        try:
            try:
                write_whole(file, lambda out: out.write(data))
            except FileNotFoundError:  # another process, which cannot see this one, took the part for a dead one's
                write_whole(file, lambda out: out.write(data))
        except OSError as error:
            raise self._not_written(error) from error

    def _remove_parts(self) -> None:
        """Remove what processes left that were killed while they wrote."""
        for part in [*self.folder.glob("*.part"), *self.folder.glob("*/*.part")]:
            writer = PART_NAME.fullmatch(part.name)
            if writer and part.is_file() and not is_process(int(writer["pid"])):
                part.unlink(missing_ok=True)

    def _not_written(self, error: OSError) -> DataError:
        return DataError(
            f"{self.setting}={self.folder} cannot be written ({os.strerror(error.errno or 0)}); give another folder,"
            " or make room"
        )


def _is_left_over(path: Path) -> bool:
    """Whether it is what a process left that was killed before it had written what the data set is."""
    if path.is_dir():
        return path.name == "images" and not any(path.iterdir())
    return path.name.startswith(f"{ABOUT}.") and path.suffix == ".part"


def contents_of(parts: Parts, plan: Plan, seed: int) -> dict[str, Any]:
    """The identity of a data set: the components, and the plan."""
    digest = hashlib.sha256("\n".join(plan.keys).encode())
    if plan.T_world_camera is not None:
        digest.update(np.ascontiguousarray(plan.T_world_camera, float).tobytes())
    applied: dict[str, Any] = {
        name: component_settings(disturbance) for name, disturbance in parts.disturbances.items()
    }
    return {
        "sensor": component_settings(parts.sensor),
        "disturbances": {"seed": seed, **applied} if applied else {},
        "planned": len(plan),
        "plan": digest.hexdigest(),
        "omitted": list(plan.omitted),
    }


def describe_camera(camera: Camera) -> dict[str, Any]:
    """Model and size of a camera and, without a calibration, the circle as the sensor `folder` takes it."""
    about: dict[str, Any] = {"model": type(camera).__name__, "width": camera.width, "height": camera.height}
    if isinstance(camera, ImageCircle):
        ring = camera.circle
        about |= {"circle_px": [ring.cx, ring.cy, ring.radius, ring.inner], "sky_inside": camera.sky_inside}
    return about


def default_settings(part: Any) -> dict[str, Any]:
    """What the settings of a component's class are if nobody says otherwise, as `component_settings` holds them."""
    return {f.name: default for f in fields(part) if (default := _default(f)) is not MISSING}


def _default(setting: Field[Any]) -> Any:
    return setting.default if setting.default_factory is MISSING else setting.default_factory()


def component_settings(part: Any) -> dict[str, Any]:
    """Class and settings of a component, which identify it."""
    return {"class": _class_name(f"{type(part).__module__}.{type(part).__qualname__}"), **asdict(part)}


def _class_name(path: str) -> str:
    """Package and name of a class: in which of the package's modules it lies may change."""
    return f"{path.partition('.')[0]}.{path.rpartition('.')[2]}"


def _flat(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """The leaves of nested dicts with their paths; an empty dict is a leaf."""
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from _flat(inner, f"{path}.{key}".strip("."))
    else:
        yield path, value


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _png(pixels: Bytes) -> bytes:
    import cv2

    # of rendered images, runs alone are found as well as all that repeats, in a third of the time
    options = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
    bgr = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR)
    good, data = cv2.imencode(".png", np.ascontiguousarray(bgr), options)
    if not good:
        raise DataError(f"an image of shape {pixels.shape} is no picture; a sensor delivers (H, W) or (H, W, 3)")
    return bytes(data)


def _csv(columns: Mapping[str, Sequence[Any]]) -> bytes:
    """Numbers are written so that they read back bit for bit."""
    import csv

    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    return stream.getvalue().encode()
