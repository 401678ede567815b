"""What shading needs of each triangle, side by side in one line of a processor's cache."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from omnilab_mirror.compiled import compiled_parallel
from omnilab_mirror.render.atlas import LUMA
from omnilab_mirror.scene.meshes.triangles import Triangles

Array = npt.NDArray[Any]
AT_ONCE = 100_000  # triangles
# columns of 32 bits, and the tint from byte TINT on; waves of rays have the first ten in rows of the same order
UV, NORMAL, DENSITY, OF_PICTURE, PAINTED, NUMBERS, TINT = 0, 6, 9, 10, 11, 16, 48


def table_of(triangles: Triangles, texels: Array, color: bool) -> Array:
    """A row (T, NUMBERS) of each triangle, whose pictures have `texels` (F,) each.

    In grey images a tint and a picture are multiplied as grey levels.
    """
    table = np.empty((len(triangles), NUMBERS), np.float32)
    uv, picture, painted, tint = map(_compact, (triangles.uv, triangles.picture, triangles.painted, triangles.colors))
    if not color:
        some = (tint[first : first + AT_ONCE] for first in range(0, len(tint), AT_ONCE))
        tint = np.concatenate([np.rint(part @ LUMA).astype(np.uint8)[..., None] for part in some])
    fill(triangles.corners, uv, picture, painted, tint, texels, table)
    return table


def _compact(values: Array) -> Array:
    """The values of each triangle, or one row where it stands for all."""
    return np.ascontiguousarray(values[:1] if values.strides[0] == 0 else values)


@compiled_parallel
def fill(corners: Array, uv: Array, picture: Array, painted: Array, tint: Array, texels: Array, table: Array) -> None:
    """Fill the table; of what has one row, all triangles have it."""
    whole, bytes_ = table.view(np.int32), table.view(np.uint8)
    for number in numba.prange(len(corners)):
        t: Any = np.int64(number)
        a, b, c = corners[t, 0], corners[t, 1], corners[t, 2]
        x0, y0, z0, x1, y1, z1 = b[0] - a[0], b[1] - a[1], b[2] - a[2], c[0] - a[0], c[1] - a[1], c[2] - a[2]
        nx, ny, nz = y0 * z1 - z0 * y1, z0 * x1 - x0 * z1, x0 * y1 - y0 * x1
        area = math.sqrt(nx * nx + ny * ny + nz * nz)
        on = uv[min(t, len(uv) - 1)]
        for i in range(3):
            table[t, UV + 2 * i], table[t, UV + 2 * i + 1] = on[i, 0], on[i, 1]
        table[t, NORMAL], table[t, NORMAL + 1], table[t, NORMAL + 2] = nx / area, ny / area, nz / area
        right, down = on[1, 0] - on[0, 0], on[1, 1] - on[0, 1]
        across, below = on[2, 0] - on[0, 0], on[2, 1] - on[0, 1]
        share = abs(right * below - across * down)  # of the picture, doubled as the area is
        shown = picture[min(t, len(picture) - 1)]
        table[t, DENSITY] = share * texels[shown] / area
        whole[t, OF_PICTURE], whole[t, PAINTED] = shown, painted[min(t, len(painted) - 1)]
        color = tint[min(t, len(tint) - 1)]
        for i in range(3):
            for k in range(tint.shape[2]):
                bytes_[t, TINT + tint.shape[2] * i + k] = color[i, k]
