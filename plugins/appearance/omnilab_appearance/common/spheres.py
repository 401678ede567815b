"""Spherical harmonics of pictures of the sphere, as `omnilab.cameras.sphere` makes them: 0 where nothing is seen."""

from __future__ import annotations

import numpy as np

from omnilab.api import Bytes, Floats
from omnilab.errors import DataError
from omnilab_appearance.common.spherical_harmonics import analysis

FLAT = 1e-3  # of the range of grey levels: a sphere that varies less is taken for constant


def coefficients_of(picture: Bytes, band_limit: int) -> Floats:
    """Real coefficients (3, L^2) of m f, m f^2 and m of a sphere (H, 2 H).

    m is 1 where the picture is above 0; f is in standard deviations over what is seen, from the mean there. Both are
    means over solid angle. Of a flat picture f is 0, of one in which nothing is seen all is.
    """
    rows, columns = picture.shape
    if columns != 2 * rows:
        raise DataError(f"a picture of {rows} x {columns} is no sphere; give one twice as wide as high")
    if 2 * band_limit > rows:
        raise DataError(
            f"a band limit of {band_limit} needs a sphere of {2 * band_limit} rows, and the camera resolves {rows}; give at most"
            f" {rows // 2}, or a sharper camera"
        )
    mask = (picture > 0).astype(float)
    area = mask * np.sin(np.pi * (np.arange(rows) + 0.5) / rows)[:, None]
    seen = max(float(area.sum()), 1e-12)
    values = picture / 255.0
    off = mask * (values - (area * values).sum() / seen)
    deviation = np.sqrt((area * off**2).sum() / seen)
    f = off / deviation if deviation > FLAT else np.zeros_like(off)
    return analysis(np.stack([f, f**2, mask]), band_limit)
