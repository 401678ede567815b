"""Cameras as other tools read them: files of OCamCalib, Kalibr, OpenCV and ROS.

Where the camera looks, and the circle that shows the world, is in none of these files.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from omnilab.api import Floats
from omnilab.atomic_files import write_whole
from omnilab.cameras.base import RayCamera
from omnilab.cameras.brown_conrady import BrownConradyCamera
from omnilab.cameras.kannala_brandt import KannalaBrandtCamera
from omnilab.cameras.lenses import AxialCamera, FisheyeCamera, PinholeCamera, UnifiedCamera
from omnilab.cameras.ocam import OCamCamera, forward
from omnilab.errors import ConfigError

RADTAN: tuple[str, ...] = ("k1", "k2", "p1", "p2")
MORE = ("k3", "k4", "k5", "k6")
EQUIDISTANT: tuple[str, ...] = ("k1", "k2", "k3", "k4")
INVERSE_DEGREES, INVERSE_PX = (
    range(5, 25),
    1e-3,
)  # of OCamCalib's polynomial of the angle: the least that is exact to this


def export_camera(camera: RayCamera, file: Path, form: str) -> None:
    """Write a camera in one of the `FORMS`; ConfigError if that cannot hold it."""
    text = FORMS[form](_general(camera))
    write_whole(file, lambda out: out.write(text.encode()))


def _general(camera: RayCamera) -> RayCamera:
    """A camera without coefficients as one of the model that has them."""
    if not isinstance(camera, FisheyeCamera | PinholeCamera):
        return camera
    family = KannalaBrandtCamera if isinstance(camera, FisheyeCamera) else BrownConradyCamera
    frame = {field.name: getattr(camera, field.name) for field in fields(AxialCamera)}
    return family(**frame, fx=camera.focal_px, fy=camera.focal_px)


# -------------------------------------------------------------------------------------------------------------- OCamCalib
def ocamcalib(camera: RayCamera) -> str:
    """The toolbox's `calib_results.txt`, with the inverse that its C functions need."""
    if not isinstance(camera, OCamCamera):
        raise _not_held(camera, "OCamCalib's calib_results.txt", "the polynomial", "ocam")
    sign = -np.sign(camera.polynomial[0])  # their z points towards the viewer
    rows = {
        "polynomial coefficients for the DIRECT mapping function (ocam_model.ss in MATLAB). These are used by cam2world":
            _counted([sign * a for a in camera.polynomial]),
        "polynomial coefficients for the inverse mapping function (ocam_model.invpol in MATLAB). These are used by world2cam":
            _counted(_inverse(camera)),
        'center: "row" and "column", starting from 0 (C convention)': _row([camera.cy, camera.cx]),
        'affine parameters "c", "d", "e"': _row([camera.c, camera.d, camera.e]),
        'image size: "height" and "width"': f"{camera.height} {camera.width}",
    }  # fmt: skip
    return "\n".join(f"#{title}\n\n{row}\n" for title, row in rows.items())


def _inverse(camera: OCamCamera) -> list[float]:
    """Coefficients, lowest first, of the radius over the angle above the plane through the viewpoint, negative ahead."""
    rho = np.linspace(0, camera.circle.radius, 500)
    z = -forward(camera.polynomial, rho)
    angle = np.arctan2(z, rho)
    scaled = angle / np.abs(angle).max()
    for degree in INVERSE_DEGREES:
        found = np.polynomial.polynomial.polyfit(scaled, rho, degree)
        if np.abs(np.polynomial.polynomial.polyval(scaled, found) - rho).max() < INVERSE_PX:
            break
    return [float(a) for a in found / np.abs(angle).max() ** np.arange(len(found))]


def _counted(numbers: list[float]) -> str:
    return f"{len(numbers)} {_row(numbers)}"


def _row(numbers: list[float]) -> str:
    return " ".join(repr(float(number)) for number in numbers)


# ----------------------------------------------------------------------------------------------------------------- Kalibr
def kalibr(camera: RayCamera) -> str:
    """A `camchain.yaml` of one camera: pinhole-equi, omni-radtan or pinhole-radtan."""
    what = "Kalibr's camchain.yaml"
    if isinstance(camera, KannalaBrandtCamera):
        model, lens, intrinsics, names = "pinhole", "equidistant", [], EQUIDISTANT
    elif isinstance(camera, UnifiedCamera):
        model, lens, intrinsics, names = "omni", "radtan", [camera.xi], RADTAN
    elif isinstance(camera, BrownConradyCamera):
        model, lens, intrinsics, names = "pinhole", "radtan", [], RADTAN
        _must_be_zero(camera, what, MORE)
    else:
        raise _not_held(camera, what, "pinhole-equi, omni-radtan and pinhole-radtan", "kannala_brandt")
    _must_be_zero(camera, what, ("skew",))
    assert isinstance(camera, KannalaBrandtCamera | UnifiedCamera | BrownConradyCamera)
    intrinsics += [camera.fx, camera.fy, camera.cx, camera.cy]
    return (
        f"cam0:\n  camera_model: {model}\n  distortion_coeffs: {_list(_values(camera, names))}\n  distortion_model: {lens}\n"
        f"  intrinsics: {_list(intrinsics)}\n  resolution: [{camera.width}, {camera.height}]\n"
    )


# -------------------------------------------------------------------------------------------------------- OpenCV and ROS
def opencv(camera: RayCamera) -> str:
    """YAML of OpenCV's FileStorage: K and coefficients of its pinhole, `fisheye` or (with xi) `omnidir`."""
    if isinstance(camera, KannalaBrandtCamera):
        names, more = EQUIDISTANT, "fisheye_model: 1\n"
    elif isinstance(camera, UnifiedCamera):
        names, more = RADTAN, f"xi: {camera.xi!r}\n"
    elif isinstance(camera, BrownConradyCamera):
        names, more = RADTAN + MORE, ""
    else:
        raise _not_held(camera, "OpenCV", "its pinhole, fisheye and omnidir", "kannala_brandt")
    return (
        f"%YAML:1.0\n---\nimage_width: {camera.width}\nimage_height: {camera.height}\n{more}"
        f"camera_matrix: !!opencv-matrix\n{_matrix(3, 3, _K(camera), 'dt: d')}"
        f"distortion_coefficients: !!opencv-matrix\n{_matrix(1, len(names), _values(camera, names), 'dt: d')}"
    )


def ros(camera: RayCamera) -> str:
    """A `camera_info` as ROS's calibrator saves it: equidistant, plumb_bob or rational_polynomial."""
    what = "ROS's camera_info"
    if isinstance(camera, KannalaBrandtCamera):
        word, names = "equidistant", EQUIDISTANT
    elif isinstance(camera, BrownConradyCamera):
        rational = any(_values(camera, MORE[1:]))
        word, names = ("rational_polynomial", RADTAN + MORE) if rational else ("plumb_bob", (*RADTAN, "k3"))
    else:
        raise _not_held(camera, what, "equidistant, plumb_bob and rational_polynomial", "kannala_brandt")
    _must_be_zero(camera, what, ("skew",))
    K = _K(camera)
    P = [*K[:3], 0.0, *K[3:6], 0.0, *K[6:], 0.0]
    return (
        f"image_width: {camera.width}\nimage_height: {camera.height}\ncamera_name: camera\n"
        f"camera_matrix:\n{_matrix(3, 3, K)}distortion_model: {word}\n"
        f"distortion_coefficients:\n{_matrix(1, len(names), _values(camera, names))}"
        f"rectification_matrix:\n{_matrix(3, 3, np.eye(3).ravel().tolist())}projection_matrix:\n{_matrix(3, 4, P)}"
    )


FORMS: Mapping[str, Callable[[RayCamera], str]] = {
    "ocamcalib": ocamcalib,
    "kalibr": kalibr,
    "opencv": opencv,
    "ros": ros,
}


def _K(camera: Any) -> list[float]:
    return [camera.fx, getattr(camera, "skew", 0.0), camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0]


def _values(camera: RayCamera, names: tuple[str, ...]) -> list[float]:
    return [float(getattr(camera, name)) for name in names]


def _matrix(rows: int, columns: int, values: list[float], more: str = "") -> str:
    lines = [f"rows: {rows}", f"cols: {columns}", *filter(None, [more]), f"data: {_list(values)}"]
    return "".join(f"  {line}\n" for line in lines)


def _list(values: list[float] | Floats) -> str:
    """Numbers as every reader of YAML takes them: 1e-05 without a point is a text to some."""
    texts = [repr(float(value)) for value in values]
    return f"[{', '.join(text if '.' in text else text.replace('e', '.0e') for text in texts)}]"


def _must_be_zero(camera: RayCamera, what: str, names: tuple[str, ...]) -> None:
    wrong = [f"{name}={getattr(camera, name):g}" for name in names if getattr(camera, name, 0.0) != 0]
    if wrong:
        raise ConfigError(f"{what} has no {', '.join(wrong)}; give --to opencv, which has, or --refit kannala_brandt")


def _not_held(camera: RayCamera, what: str, held: str, model: str) -> ConfigError:
    return ConfigError(
        f"{what} holds {held}, and no {type(camera).__name__}; give --refit {model}, which says what it costs"
    )
