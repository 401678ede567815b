"""Kalibr's `camchain.yaml` (also that of OpenVINS), and the `sensor.yaml` of EuRoC's data sets."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from omnilab.cameras.brown_conrady import BrownConradyCamera
from omnilab.cameras.formats.entry import CameraParameters, Entry
from omnilab.cameras.kannala_brandt import KannalaBrandtCamera
from omnilab.cameras.lenses import UnifiedCamera
from omnilab.errors import DataError

RADTAN = ("radtan", "radial-tangential", "plumb_bob")
EQUIDISTANT = ("equidistant", "equi")
FRAME = ("fx", "fy", "cx", "cy")
UNUSED = ("T_cam_imu", "T_imu_cam", "T_cn_cnm1", "T_BS", "timeshift_cam_imu")  # where the camera is, and its clock


def entries(found: Mapping[str, Any]) -> dict[str, Any]:
    """The cameras of a camchain by name, or the one camera of a sensor.yaml; none if this is neither."""
    if "camera_model" in found and "intrinsics" in found:
        return {"": found}
    return {key: value for key, value in found.items() if re.fullmatch(r"cam\d+", key) and isinstance(value, Mapping)}


def calibration(entry: Entry) -> CameraParameters:
    """Pinhole or omni with radtan, pinhole with equidistant, or without distortion; DataError for other models."""
    camera, lens = entry.word("camera_model"), _lens(entry)
    size = entry.size_of("resolution")
    unused = [key for key in UNUSED if key in entry.values]
    if camera == "omni" and lens != "equidistant":
        xi, *intrinsics = entry.numbers("intrinsics", 5)
        settings = dict(zip(FRAME, intrinsics, strict=True)) | _coefficients(entry, lens, "k1 k2 p1 p2")
        return CameraParameters(UnifiedCamera, settings | {"xi": xi}, size, unused)
    if camera == "pinhole":
        settings = dict(zip(FRAME, entry.numbers("intrinsics", 4), strict=True))
        if lens == "equidistant":
            return CameraParameters(
                KannalaBrandtCamera, settings | _coefficients(entry, lens, "k1 k2 k3 k4"), size, unused
            )
        return CameraParameters(BrownConradyCamera, settings | _coefficients(entry, lens, "k1 k2 p1 p2"), size, unused)
    raise DataError(
        f"{entry.title} has the model {camera} with {lens}, which is not read; calibrate with Kalibr's pinhole-radtan,"
        " pinhole-equi or omni-radtan"
    )


def _lens(entry: Entry) -> str:
    """radtan, equidistant or none, or another word of the file."""
    if "distortion_model" not in entry.values:
        return "none"
    word = entry.word("distortion_model")
    return "radtan" if word in RADTAN else "equidistant" if word in EQUIDISTANT else word


def _coefficients(entry: Entry, lens: str, names: str) -> dict[str, float]:
    if lens == "none":
        return {}
    if lens not in {"radtan", "equidistant"}:
        raise DataError(
            f"{entry.title} has the distortion {lens}, which is not read; calibrate with radtan or equidistant"
        )
    key = "distortion_coeffs" if "distortion_coeffs" in entry.values else "distortion_coefficients"
    if key not in entry.values:
        raise DataError(f"{entry.title} has no distortion_coeffs, though it says distortion_model={lens}; add them")
    return dict(zip(names.split(), entry.numbers(key, 4), strict=True))
