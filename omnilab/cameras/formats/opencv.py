"""Camera matrix and distortion coefficients: OpenCV's files (YAML or JSON), and ROS's `camera_info`, saved or echoed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from omnilab.cameras.brown_conrady import BrownConradyCamera
from omnilab.cameras.formats.entry import CameraParameters, Entry
from omnilab.cameras.kannala_brandt import KannalaBrandtCamera
from omnilab.cameras.lenses import UnifiedCamera
from omnilab.errors import ConfigError, DataError

MATRIX = ("camera_matrix", "cameramatrix", "intrinsic_matrix", "mtx", "k", "m")  # in lower case
COEFFICIENTS = ("distortion_coefficients", "distcoeffs", "dist_coeffs", "distortion_coeffs", "dist", "d")
WIDTH, HEIGHT = ("image_width", "width"), ("image_height", "height")
RADTAN = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
EQUIDISTANT = ("k1", "k2", "k3", "k4")
LENSES = {  # the words of distortion_model and what they mean here
    "radtan": "radtan", "plumb_bob": "radtan", "rational_polynomial": "radtan", "pinhole": "radtan", "": "radtan",
    "none": "radtan", "equidistant": "equidistant", "fisheye": "equidistant", "kannala_brandt": "equidistant",
}  # fmt: skip


def entries(found: Mapping[str, Any]) -> dict[str, Any]:
    """The one camera of the file, or both of a stereo pair as "1" and "2"; none if this is no such file."""
    if _key(found, MATRIX) and (_key(found, COEFFICIENTS) or _key(found, WIDTH)):
        return {"": found}
    names = {str(key): value for key, value in found.items()}
    pairs = {}
    for which in ("1", "2"):
        matrix, lens = (_key(names, [f"{word}{which}" for word in words]) for words in (MATRIX, COEFFICIENTS))
        if matrix and lens:
            shared = {key: value for key, value in names.items() if not key.endswith(("1", "2"))}
            pairs[which] = shared | {"camera_matrix": names[matrix], "distortion_coefficients": names[lens]}
    return pairs


def calibration(entry: Entry, distortion: str | None) -> CameraParameters:
    """The camera; ConfigError if the coefficients may be of two models and `distortion` does not say of which."""
    found = entry.values
    matrix, lens = _key(found, MATRIX), _key(found, COEFFICIENTS)
    assert matrix is not None
    fx, skew, cx, zero, fy, cy, *last = entry.numbers(matrix, 9)
    if (zero, *last) != (0, 0, 0, 1):
        transposed = " it is the transpose, as MATLAB writes it;" if cx == cy == 0 and last[2] == 1 else ""
        raise DataError(
            f"{entry.title} has a {matrix} that is none;{transposed} write fx 0 cx, 0 fy cy, 0 0 1, row by row"
        )
    if fx == fy == 0:
        raise DataError(f"{entry.title} has a {matrix} of zeros: this camera was not calibrated; calibrate it first")
    _check_whole_frame(entry)
    if lens is None:
        raise DataError(
            f"{entry.title} has no distortion_coefficients; write [0, 0, 0, 0, 0] if the lens has no distortion"
        )
    plane = {"fx": fx, "fy": fy, "cx": cx, "cy": cy}
    size = _size(entry)
    unused = _unused(entry)
    if "xi" in found:
        settings = plane | _named(entry, lens, RADTAN[:4], "omnidir") | {"xi": entry.number("xi"), "skew": skew}
        return CameraParameters(UnifiedCamera, settings, size, unused)
    if _lens_of(entry, lens, distortion) == "equidistant":
        settings = plane | _named(entry, lens, EQUIDISTANT, "fisheye") | {"skew": skew}
        return CameraParameters(KannalaBrandtCamera, settings, size, unused)
    if skew != 0:
        raise DataError(f"{entry.title} has the skew {skew:g}, which a pinhole of OpenCV has not; write 0 there")
    return CameraParameters(BrownConradyCamera, plane | _named(entry, lens, RADTAN, "pinhole"), size, unused)


def _lens_of(entry: Entry, lens: str, distortion: str | None) -> str:
    """radtan or equidistant: as the file says, or else the user."""
    says = _said_lens(entry)
    if says is None and entry.count(lens) != 4:
        says = "radtan"  # a fisheye has four
    if says is None and distortion is None:
        raise ConfigError(
            f"{entry.title} has four distortion coefficients and does not say of which model: k1, k2, p1, p2 of a pinhole,"
            " or k1 to k4 of a fisheye; give distortion=radtan or"
            " distortion=equidistant (sensor.distortion=radtan in a run, --distortion of omnilab check)"
        )
    if says is not None and distortion is not None and says != distortion:
        raise ConfigError(f"distortion={distortion} is given, but {entry.title} is of {says}; leave distortion out")
    return says or str(distortion)


def _said_lens(entry: Entry) -> str | None:
    """What the file says of its lens itself; None if nothing."""
    if "distortion_model" in entry.values:
        word = entry.word("distortion_model")
        if word not in LENSES:
            raise DataError(
                f"{entry.title} has distortion_model={word}, which is not read; calibrate with plumb_bob,"
                " rational_polynomial or equidistant"
            )
        return LENSES[word]
    if "fisheye_model" in entry.values:
        return "equidistant" if entry.values["fisheye_model"] in (1, True) else "radtan"
    return None


def _named(entry: Entry, lens: str, names: tuple[str, ...], model: str) -> dict[str, float]:
    """The coefficients by name; those beyond, of thin prisms and tilted sensors, must be 0."""
    if entry.count(lens) == 0:
        return {}
    allowed = {"omnidir": (4,), "fisheye": (4,), "pinhole": (4, 5, 8, 12, 14)}[model]
    values = entry.numbers(lens, *allowed)
    if any(values[len(names) :]):
        raise DataError(
            f"{entry.title} has coefficients of a thin prism or a tilted sensor, which are not read; calibrate without"
        )
    return dict(zip(names, values, strict=False))


def _size(entry: Entry) -> tuple[int, int] | None:
    width, height = _key(entry.values, WIDTH), _key(entry.values, HEIGHT)
    if width is None and height is None:
        return entry.size_of("image_size")
    return entry.size(width or WIDTH[0], height or HEIGHT[0])


def _check_whole_frame(entry: Entry) -> None:
    """DataError for a camera_info of binned or cut pictures."""
    binned = [key for key in ("binning_x", "binning_y") if entry.values.get(key) not in (None, 0, 1)]
    roi = entry.values.get("roi")
    cut = isinstance(roi, Mapping) and any(roi.get(key) for key in ("x_offset", "y_offset", "width", "height"))
    if binned or cut:
        raise DataError(
            f"{entry.title} is of pictures that are {'binned' if binned else 'cut (roi)'}, and its numbers of the whole ones;"
            " calibrate the pictures as they are"
        )


def _unused(entry: Entry) -> list[str]:
    """A rectification that is one: it is of other pictures than the camera's own."""
    for key in ("rectification_matrix", "R", "r"):
        if key in entry.values and entry.count(key) == 9:
            matrix = entry.numbers(key, 9)
            return [key] if matrix != [1, 0, 0, 0, 1, 0, 0, 0, 1] and any(matrix) else []
    return []


def _key(found: Mapping[str, Any], names: Any) -> str | None:
    """The key of a file that is one of the names, whatever its case."""
    return next((str(key) for name in names for key in found if str(key).lower() == name), None)
