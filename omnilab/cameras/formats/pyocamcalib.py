"""The JSON of py-OCamCalib: OCamCalib's polynomial, its affine matrix in the order right, down."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from omnilab.cameras.formats.entry import CameraParameters, Entry
from omnilab.cameras.ocam import MOST_COEFFICIENTS, OCamCamera
from omnilab.errors import DataError


def entries(found: Mapping[str, Any]) -> dict[str, Any]:
    """The one camera of the file; none if this is no such file."""
    return {"": found} if "taylor_coefficient" in found else {}


def calibration(entry: Entry) -> CameraParameters:
    """The camera, without the size of its images, which the file does not hold.

    A pixel at (right, down) from the centre is [[C, D], [E, 1]] (X, Y) and looks to (X, Y, f(rho)). `OCamCamera` has
    the axes the other way round, as OCamCalib's own files have them. With (x, y) = C (Y, X) both are the same camera:
    c = 1 / C, d = E / C, e = D / C, and each coefficient a_i becomes C^(1 - i) a_i, for rho grows by C.
    """
    polynomial = entry.numbers("taylor_coefficient", *range(1, MOST_COEFFICIENTS + 1))
    C, D, E, one = entry.numbers("stretch_matrix", 4)
    if one != 1 or C <= 0:
        raise DataError(
            f"{entry.title} has stretch_matrix=[[{C:g}, {D:g}], [{E:g}, {one:g}]]; write [[c, d], [e, 1]], c > 0"
        )
    cx, cy = entry.numbers("distortion_center", 2)
    settings = {
        "polynomial": tuple(C ** (1 - i) * a for i, a in enumerate(polynomial)),
        "cx": cx, "cy": cy, "c": 1 / C, "d": E / C, "e": D / C,
    }  # fmt: skip
    return CameraParameters(OCamCamera, settings, entry.size_of("image_size"))
