"""Validation of image pairs."""

from __future__ import annotations

from omnilab.api import Bytes, Camera
from omnilab.errors import DataError


def check_pairs(references: Bytes, tests: Bytes, camera: Camera) -> None:
    """DataError unless these are grey images of one size, the camera's, with one reference or as many as tests."""
    if references.ndim != 3 or tests.ndim != 3:
        raise DataError(f"images of shape {references.shape} and {tests.shape} are not grey; give (N, H, W)")
    sizes = {(camera.height, camera.width), references.shape[1:], tests.shape[1:]}
    if len(sizes) > 1:
        raise DataError(
            f"the reference is {_size(references)} pixels, the test {_size(tests)}, and the camera's images are"
            f" {camera.width} x {camera.height}; give images of one camera, uncropped and of one size"
        )
    if len(references) not in (1, len(tests)):
        raise DataError(
            f"{len(references)} references were given for {len(tests)} tests; give one, or one for each test"
        )


def _size(images: Bytes) -> str:
    return f"{images.shape[2]} x {images.shape[1]}"
