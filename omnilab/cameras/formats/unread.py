"""Files that are no calibration that is read: what each of them is, and the way round."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from omnilab.file_kinds import kind_of_file

READ = (
    "a camera.json, OCamCalib's calib_results.txt, py-OCamCalib's JSON, YAML of Kalibr, OpenCV, Camodocal or KITTI-360,"
    " ROS's camera_info"
)
ECHO = "calibrate with it, or echo its camera_info into a YAML file"
AS_YAML = "write K and the coefficients as YAML"
TEXT = ("JSON", "XML", "HTML")  # which are read, or known by what they hold
REMEDIES = {  # by a word of what a file is (`omnilab.file_kinds`)
    "ROS": ECHO,
    "MCAP": ECHO,
    "MATLAB file": f"export calib_results.txt from OCamCalib, or {AS_YAML}",
    "gzip": "unpack it; ROS's calibrationdata.tar.gz holds ost.yaml",
    "picture": "give the file that describes its camera",
    "PDF": "give the YAML file beside the report",
    "NumPy": AS_YAML,
    "zip": f"unpack it, or {AS_YAML}",
    "pickle": AS_YAML,
}
NUMBERS = "write its numbers into a camera.json"
HALF = (
    f"{NUMBERS}: OPENCV is a BrownConradyCamera, OPENCV_FISHEYE a KannalaBrandtCamera, with 0.5 less in cx and cy, for"
    " COLMAP counts pixels from their corners"
)
TEXTS = (  # a regular expression that finds, in the first lines of a text, what it is, the way round
    (r"<opencv_storage", "OpenCV's XML", "write it as YAML: the same cv2.FileStorage with a name that ends in .yml"),
    (r"<(sdf|world|gazebo)\b", "a Gazebo world", "echo the camera_info that Gazebo publishes into a YAML file"),
    (r"<robot\b", "a robot's description (URDF)", "echo the camera_info that its camera publishes into a YAML file"),
    (r"<launch\b", "a ROS launch file", "give the camera_info that it names"),
    (r"^\s*<", "an XML file", AS_YAML),
    (r"^# Camera list with one line of data per camera", "COLMAP's cameras.txt", HALF),
    (r"^\d+ (SIMPLE_|FULL_)?(PINHOLE|OPENCV|RADIAL|FOV)\w* \d+ \d+ ", "COLMAP's cameras.txt", HALF),
    (
        r"^(P0|P_rect_0\d|K_0\d):",
        "KITTI's calib file",
        "its pictures are rectified: a BrownConradyCamera in a camera.json",
    ),
    (r"^(Pinhole|FOV|RadTan|EquiDistant|KannalaBrandt) [-\d.]+ [-\d.]+ ", "DSO's camera.txt", NUMBERS),
    (r"^# oST version", "ROS's ost.txt", "give ost.yaml, which the calibrator writes beside it"),
    (r"^Calibration results|^Camera-system parameters", "a report of Kalibr", "give the camchain.yaml beside it"),
)
KEYS: tuple[tuple[Callable[[set[str]], bool], str, str], ...] = (  # of a mapping's keys
    (lambda keys: bool({"Camera.fx", "Camera1.fx"} & keys), "ORB-SLAM's settings", NUMBERS),
    (lambda keys: "cam0_calib" in keys, "a configuration of VINS-Fusion", "give the file that its cam0_calib names"),
    (lambda keys: "value0" in keys, "a calibration of Basalt", NUMBERS),
    (lambda keys: bool({"fl_x", "camera_angle_x", "frames"} & keys), "a transforms.json of NeRF tools", NUMBERS),
    (lambda keys: "sfm_data_version" in keys, "OpenMVG's sfm_data", NUMBERS),
    (lambda keys: "featuresFolders" in keys, "a scene of Meshroom", NUMBERS),
    (lambda keys: any("accelerometer" in key or key == "imu0" for key in keys), "of an IMU", "give the camera's file"),
    (lambda keys: "target_type" in keys, "Kalibr's target", "give the camchain.yaml that Kalibr wrote"),
    (lambda keys: "poly_parameters" in keys, "Camodocal's SCARAMUZZA", "give the calib_results.txt that it came from"),
)


def known_file(path: Path) -> str | None:
    """What a file is by its first bytes, and the way round; None if it may be a text that is read. OSError if none is there."""
    kind = kind_of_file(path)
    if kind is None or kind in TEXT:
        return None
    remedy = next((remedy for word, remedy in REMEDIES.items() if word in kind), f"give {READ}")
    return f"is {kind}, and no calibration that is read; {remedy}"


def known_text(text: str) -> str | None:
    """What a text is by its first lines, and the way round; None if it may be JSON, YAML or OCamCalib's."""
    head = text[:4096]
    for pattern, what, remedy in TEXTS:
        if re.search(pattern, head, re.MULTILINE):
            return f"is {what}, and no calibration that is read; {remedy}"
    return None


def known_keys(found: Mapping[str, Any]) -> str:
    """What a JSON or YAML file is by its keys, and the way round."""
    keys = {str(key) for key in found}
    for matches, what, remedy in KEYS:
        if matches(keys):
            return f"is {what}, and no calibration that is read; {remedy}"
    named = ", ".join(sorted(keys)[:4]) or "nothing"
    return f"describes no camera that is read (it holds {named[:80]}); give {READ}"
