"""The layouts: which files are the images, when they were taken, where the camera was, and what it is."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import chain
from pathlib import Path

import numpy as np

from omnilab.api import Floats, Ints
from omnilab.errors import DataError
from omnilab.file_kinds import content_of
from omnilab.geometry import poses
from omnilab.trajectory.columns import POSITION
from omnilab.trajectory.files import Trajectory, read_trajectory
from omnilab.trajectory.tables import KITTI_ROW, PoseTable
from omnilab_recordings.images.files import SUFFIXES, image_names
from omnilab_recordings.optical_axes import optical_to_camera

LARGEST_TEXT = 2**28  # bytes
LAST_YEAR = 2200  # of what 64 bits of nanoseconds hold
DATE = re.compile(r"(\d{4}-\d\d-\d\d)[ T](\d\d:\d\d:\d\d)(?:\.(\d{1,9}))?")


@dataclass(frozen=True)
class SequenceFiles:
    """N images of a sequence, and what lies beside them."""

    images: Sequence[Path]
    stamps_ns: Ints  # (N,)
    poses: Trajectory | None  # T_world_optical
    camera: Path | None  # its calibration
    remarks: Mapping[str, str] = field(default_factory=dict)


def read_sequence(folder: Path, which: str | None, looks: str) -> SequenceFiles:
    """The sequence in a folder, by whichever layout it has; poses are turned to omnilab's frame for a camera that `looks` so."""
    for is_one, read in LAYOUTS.values():
        if is_one(folder):
            found = read(folder, which)
            if found.poses is None:
                return found
            turned = Trajectory(found.poses.T_world_camera @ optical_to_camera(looks), found.poses.stamps_ns)
            return SequenceFiles(found.images, found.stamps_ns, turned, found.camera, found.remarks)
    raise DataError(
        f"{folder} has none of the layouts that are read: {', '.join(LAYOUTS)}; give sensor.path=DIR of one, or take sensor=folder"
    )


# ----------------------------------------------------------------------------------------------------------------- TUM
def _tum(folder: Path, which: str | None) -> SequenceFiles:
    """rgb.txt (time and file in each line) and groundtruth.txt (time, position, quaternion x y z w)."""
    listing = folder / f"{which or 'rgb'}.txt"
    table = _table(listing, ("stamp_s", "image"))
    truth = folder / "groundtruth.txt"
    path = read_trajectory(truth, lenient=True) if truth.is_file() else None
    return SequenceFiles([_below(folder, name, listing) for name in table.images()], _stamps(table), path, None)


# --------------------------------------------------------------------------------------------------------------- EuRoC
def _euroc(folder: Path, which: str | None) -> SequenceFiles:
    """mav0/cam0/data.csv (nanoseconds and file), sensor.yaml (T_BS), and the body's poses: quaternions w x y z."""
    mav = folder / "mav0" if (folder / "mav0").is_dir() else folder
    camera = mav / (which or "cam0")
    listing = camera / "data.csv"
    table = _table(listing, ("stamp_ns", "image"), ",")
    images = [_below(camera / "data", name, listing) for name in table.images()]
    truth = next((mav / name / "data.csv" for name in TRUTHS if (mav / name / "data.csv").is_file()), None)
    calibration = camera / "sensor.yaml"
    if truth is None:
        return SequenceFiles(images, _stamps(table), None, calibration)
    of_body = _table(truth, ("stamp_ns", *POSITION, "qw", "qx", "qy", "qz"), ",")  # what follows is of no use here
    T = poses(of_body.position_m(), of_body.rotations(lenient=True)) @ _body_to_camera(calibration)
    assumed = {
        "poses of": f"poses are those of {truth.parent.name}, and T_BS of {calibration.name} leads to the camera"
    }
    return SequenceFiles(images, _stamps(table), Trajectory(T, _stamps(of_body)), calibration, assumed)


def _body_to_camera(file: Path) -> Floats:
    """T_body_optical (4, 4), T_BS of a sensor.yaml."""
    from omnilab.cameras.formats.entry import Entry
    from omnilab.cameras.formats.safe_yaml import load_yaml

    found = load_yaml(file, _text(file))
    if not isinstance(found, Mapping):
        raise DataError(f"{file} is no sensor.yaml of EuRoC; give the file of the set")
    numbers = Entry(file, "", found).numbers("T_BS", 16)
    return _one_rigid(file, (1, list(map(repr, numbers[:12]))))


# ----------------------------------------------------------------------------------------------------------- KITTI-360
def _kitti360(folder: Path, which: str | None) -> SequenceFiles:
    """image_02/data_rgb and timestamps.txt; poses.txt (frame and 12 numbers) of the vehicle, calib_cam_to_pose.txt, image_02.yaml."""
    which = which or next(name for name in KITTI_CAMERAS if (folder / name).is_dir())
    camera = folder / which
    data = next(
        (camera / name for name in ("data_rgb", "data_rect", "data") if (camera / name).is_dir()), camera / "data_rgb"
    )
    listing = camera / "timestamps.txt"
    times = [_date(" ".join(row), listing, number) for number, row in _rows(listing)]
    files = image_names(data, "*") if data.is_dir() else []
    numbers = [_frame(name, data, len(times)) for name in files]
    stamps = np.array([times[n] for n in numbers], np.int64)
    images = [data / name for name in files]
    calibration = _beside(folder, "calibration", f"{which}.yaml")
    truth, mounted = _beside(folder, "data_poses", "poses.txt"), _beside(folder, "calibration", "calib_cam_to_pose.txt")
    if truth is None or mounted is None:
        lacks = {"poses": f"there are no poses: poses.txt or calib_cam_to_pose.txt is not beside {folder}"}
        return SequenceFiles(images, stamps, None, calibration, lacks)
    lines = list(_rows(truth))
    of_vehicle = _rigid(truth, [(number, row[1:]) for number, row in lines])
    at = np.array([times[_frame(row[0], truth, len(times))] for _, row in lines], np.int64)
    assumed = {"poses of": f"poses are those of {truth.name}, of the vehicle, and {mounted.name} leads to {which}"}
    path = Trajectory(of_vehicle @ _mounted(mounted, which), at)
    return SequenceFiles(images, stamps, path, calibration, assumed)


def _mounted(file: Path, which: str) -> Floats:
    """T_vehicle_optical (4, 4) of a camera: its line, `image_02: ` and 12 numbers."""
    for number, row in _rows(file):
        if row[0].rstrip(":") == which:
            return _one_rigid(file, (number, row[1:]))
    raise DataError(f"{file} does not say where {which} is; give the calibration of the set")


def _beside(folder: Path, part: str, name: str) -> Path | None:
    """A file of KITTI-360's, in the sequence's folder or where the set has it (../../data_poses/DRIVE, ../../calibration)."""
    root = folder.absolute().parent.parent
    places = (folder / name, root / part / folder.absolute().name / name, root / part / name)
    return next((place for place in places if place.is_file()), None)


def _frame(name: str, of: Path, count: int) -> int:
    digits = Path(name).stem
    if not (digits.isascii() and digits.isdigit() and len(digits) < 19) or int(digits) >= count:
        raise DataError(f"{of} has the frame {name[:40]}, and timestamps.txt has {count}; give the set's own files")
    return int(digits)


# ------------------------------------------------------------------------------------------------------------- reading
def _text(file: Path) -> str:
    try:
        return content_of(file, LARGEST_TEXT).decode("utf-8-sig", "replace")
    except OSError as error:
        raise DataError(f"{file} cannot be read ({error.strerror}); give the folder of the whole sequence") from None


def _rows(file: Path, separator: str | None = None) -> Iterator[tuple[int, list[str]]]:
    """Number and words of each line that is no comment; DataError if there is none."""
    found = False
    for number, line in enumerate(_text(file).splitlines(), 1):
        if line.strip() and not line.startswith("#"):
            found = True
            yield number, line.strip().split(separator)
    if not found:
        raise DataError(f"{file} holds no line; give the folder of the whole sequence")


def _table(file: Path, columns: Sequence[str], separator: str | None = None) -> PoseTable:
    """Lines of values by the names of their columns; what follows on a line is left aside."""
    rows = ((number, [word.strip() for word in row[: len(columns)]]) for number, row in _rows(file, separator))
    return PoseTable(file, chain([(0, list(columns))], rows))


def _rigid(file: Path, rows: Sequence[tuple[int, list[str]]]) -> Floats:
    """Poses (N, 4, 4) of 12 numbers each; DataError, with the line, for what is no rigid motion."""
    table = PoseTable(file, chain([(0, list(KITTI_ROW))], iter(rows)))
    return poses(table.position_m(), table.rotations())


def _one_rigid(file: Path, row: tuple[int, list[str]]) -> Floats:
    T: Floats = _rigid(file, [row])[0]
    return T


def _stamps(table: PoseTable) -> Ints:
    found = table.stamps_ns()
    assert found is not None  # there is a column for it
    return found


def _date(text: str, file: Path, number: int) -> int:
    """Nanoseconds since 1970 of a date and time, taken as UTC."""
    found = DATE.fullmatch(text)
    try:
        assert found is not None
        moment = datetime.fromisoformat(f"{found[1]}T{found[2]}").replace(tzinfo=UTC)
    except (AssertionError, ValueError):
        raise DataError(f"line {number} of {file} has {text[:40]!r}, which is no date and time; mend it") from None
    if moment.year > LAST_YEAR:
        raise DataError(f"line {number} of {file} has the year {moment.year}, which is none of a recording; mend it")
    return int(moment.timestamp()) * 10**9 + int((found[3] or "").ljust(9, "0"))


def _below(folder: Path, name: str, listing: Path) -> Path:
    """A file below a folder, as a listing names it; DataError for names that lead elsewhere, or are of no image."""
    path = Path(name)
    if path.is_absolute() or ".." in path.parts or path.suffix.lower() not in SUFFIXES:
        raise DataError(f"{listing} names {name[:60]!r}, which is no image below {folder}; mend it")
    return folder / path


TRUTHS = ("state_groundtruth_estimate0", "mocap0", "vicon0")
KITTI_CAMERAS = ("image_02", "image_03", "image_00", "image_01")
Layout = tuple[Callable[[Path], bool], Callable[[Path, str | None], SequenceFiles]]
LAYOUTS: Mapping[str, Layout] = {
    "TUM (rgb.txt, groundtruth.txt)": (lambda folder: (folder / "rgb.txt").is_file(), _tum),
    "EuRoC (mav0/cam0/data.csv)": (
        lambda folder: any((folder / part / "cam0/data.csv").is_file() for part in ("mav0", ".")), _euroc),
    "KITTI-360 (image_02/data_rgb, image_02/timestamps.txt)": (
        lambda folder: any((folder / name / "timestamps.txt").is_file() for name in KITTI_CAMERAS), _kitti360),
}  # fmt: skip
