"""Depth images beside rendered images: depth/NAME.npy for images/NAME.png."""

from __future__ import annotations

import io
from pathlib import Path, PurePosixPath

import numpy as np

from omnilab.api import Floats
from omnilab.errors import DataError
from omnilab_recordings.images.files import read_bytes


def read_depth(folder: Path, image: str, shape: tuple[int, ...]) -> Floats:
    """Depth (H, W) float32 in metres along the rays of an image's pixels; DataError if the file holds something else."""
    path = PurePosixPath(image)
    around = path.parent.parent if path.parent.name else path.parent
    name = str(around / "depth" / f"{path.stem}.npy")
    stream = io.BytesIO(read_bytes(folder, name))
    try:  # the header is checked before anything of the size that it claims is made
        version = np.lib.format.read_magic(stream)
        found, in_columns, dtype = np.lib.format.read_array_header_1_0(stream)
        if (version, found, in_columns, dtype) != ((1, 0), shape, False, np.dtype("<f4")):
            raise ValueError(f"it holds {dtype} {found}")
        return np.frombuffer(stream.read(), np.float32).reshape(shape)
    except ValueError as error:
        raise DataError(f"{name} is no depth of {image}, float32 {shape} ({error}); render it again") from error
