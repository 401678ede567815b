"""The coloured point cloud of a data set with depth, as binary PLY."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import numpy.typing as npt

from omnilab.api import Bytes, Floats, Ints
from omnilab.arrays import read_npy
from omnilab.atomic_files import write_whole
from omnilab.cameras import RayCamera
from omnilab.errors import DataError
from omnilab.file_kinds import content_of
from omnilab.image import point_cloud
from omnilab_studies.common.dataset_files import DataSet

LARGEST_FILE = 2**30  # bytes, of a depth image
PER_IMAGE = 2000  # points; few images give more each
VERTEX = np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3)])


def cloud_of(
    data: DataSet, numbers: Ints, camera: RayCamera, T_world_camera: Floats, most: int
) -> npt.NDArray[np.void]:
    """At most `most` points of type `VERTEX`, drawn from images spread evenly over the data set (Berenguer, thesis, figure 3.13).

    `numbers` (n,) are its frames, `T_world_camera` (N, 4, 4) the poses of the plan.
    """
    images = min(len(numbers), -(-most // PER_IMAGE))
    chosen = numbers[np.linspace(0, len(numbers) - 1, images).astype(int)]
    rng = np.random.default_rng(0)
    parts = [_points_of_frame(data, int(n), camera, T_world_camera[n], -(-most // images), rng) for n in chosen]
    return np.concatenate(parts)[:most]


def write_ply(file: Path, points: npt.NDArray[np.void]) -> None:
    """Write points of type `VERTEX` (n,): x, y, z in metres in the world, red, green, blue."""
    properties = [f"property float {axis}" for axis in "xyz"]
    properties += [f"property uchar {name}" for name in ("red", "green", "blue")]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}", *properties, "end_header", ""]
    write_whole(file, lambda out: out.write("\n".join(header).encode() + points.tobytes()))


def _points_of_frame(
    data: DataSet, n: int, camera: RayCamera, T_world_camera: Floats, most: int, rng: np.random.Generator
) -> npt.NDArray[np.void]:
    """At most `most` random points of frame n."""
    points, pixels = point_cloud(_depth(data, n), camera, T_world_camera), data.read(n)
    rows, columns = np.nonzero(np.isfinite(points).all(-1))
    taken = rng.permutation(len(rows))[:most]
    cloud = np.empty(len(taken), VERTEX)
    cloud["xyz"] = points[rows[taken], columns[taken]]
    cloud["rgb"] = _rgb(pixels)[rows[taken], columns[taken]]
    return cloud


def _depth(data: DataSet, n: int) -> Floats:
    try:
        content = content_of(data.depth(n), LARGEST_FILE)
        return np.asarray(read_npy(io.BytesIO(content), len(content)), np.float32)
    except (OSError, ValueError) as error:
        raise DataError(
            f"{data.depth(n)} cannot be read ({error}); delete {data.image(n)} and run this again"
        ) from None


def _rgb(pixels: Bytes) -> Bytes:
    return pixels if pixels.ndim == 3 else np.repeat(pixels[..., None], 3, -1)
