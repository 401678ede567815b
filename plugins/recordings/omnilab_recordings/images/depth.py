"""Depth images beside rendered images: depth/NAME.npy for images/NAME.png."""

from __future__ import annotations

import io
from pathlib import Path, PurePosixPath

import numpy as np

from omnilab.api import Floats
from omnilab.arrays import read_npy
from omnilab.errors import DataError
from omnilab_recordings.images.files import read_bytes


def read_depth(folder: Path, image: str, shape: tuple[int, ...]) -> Floats:
    """Depth (H, W) float32 in metres along the rays of an image's pixels; DataError if the file holds something else."""
    path = PurePosixPath(image)
    around = path.parent.parent if path.parent.name else path.parent
    name = str(around / "depth" / f"{path.stem}.npy")
    data = read_bytes(folder, name)
    try:
        depth = read_npy(io.BytesIO(data), len(data))
        if (depth.dtype, depth.shape) != (np.dtype("<f4"), shape):
            raise ValueError(f"it holds {depth.dtype} {depth.shape}")
        if (depth < 0).any():
            raise ValueError("it holds depths below 0")
    except ValueError as error:
        raise DataError(f"{name} is no depth of {image}, float32 {shape} ({error}); render it again") from error
    return depth
