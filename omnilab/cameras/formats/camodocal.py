"""Camodocal's YAML, which VINS-Mono, VINS-Fusion and KITTI-360 use: MEI, PINHOLE, PINHOLE_FULL and KANNALA_BRANDT."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from omnilab.cameras.brown_conrady import BrownConradyCamera
from omnilab.cameras.formats.entry import CameraParameters, Entry
from omnilab.cameras.kannala_brandt import KannalaBrandtCamera
from omnilab.cameras.lenses import AxialCamera, UnifiedCamera
from omnilab.errors import DataError

PLANE = {"fx": "fx", "fy": "fy", "cx": "cx", "cy": "cy"}
RADTAN = ("k1", "k2", "p1", "p2")
# model_type: the model, what stands below projection_parameters as its settings, what below distortion_parameters
MODELS: dict[str, tuple[type[AxialCamera], dict[str, str], tuple[str, ...]]] = {
    "mei": (UnifiedCamera, {"fx": "gamma1", "fy": "gamma2", "cx": "u0", "cy": "v0"}, RADTAN),
    "pinhole": (BrownConradyCamera, PLANE, RADTAN),
    "pinhole_full": (BrownConradyCamera, PLANE, (*RADTAN, "k3", "k4", "k5", "k6")),
    "kannala_brandt": (
        KannalaBrandtCamera,  # their k2 is the coefficient of the angle's third power, our k1
        {"fx": "mu", "fy": "mv", "cx": "u0", "cy": "v0", "k1": "k2", "k2": "k3", "k3": "k4", "k4": "k5"},
        (),
    ),
}
UNUSED = ("extrinsicRotation", "extrinsicTranslation", "body_T_cam0", "body_T_cam1", "td")


def entries(found: Mapping[str, Any]) -> dict[str, Any]:
    """The one camera of the file; none if this is no such file."""
    return {"": found} if "model_type" in found else {}


def calibration(entry: Entry) -> CameraParameters:
    """The camera; DataError for a model that is not read."""
    word = entry.word("model_type")
    if word not in MODELS:
        hint = "; give the calib_results.txt of OCamCalib that it came from" if word == "scaramuzza" else ""
        raise DataError(
            f"{entry.title} has model_type={word.upper()}, which is not read (but {', '.join(MODELS).upper()})"
            + (hint or "; calibrate with one of these")
        )
    model, projection, distortion = MODELS[word]
    below = entry.group("projection_parameters")
    settings = {name: below.number(key) for name, key in projection.items()}
    if distortion:
        lens = entry.group("distortion_parameters")
        settings |= {name: lens.number(name) for name in distortion}
    if word == "mei":
        settings["xi"] = entry.group("mirror_parameters").number("xi")
    unused = [key for key in UNUSED if key in entry.values]
    return CameraParameters(model, settings, entry.size("image_width", "image_height"), unused)
