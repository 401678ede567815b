from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

Write = Callable[..., Path]


@pytest.fixture
def write_recording(tmp_path: Path) -> Write:
    """Write images (and, with rows, a positions file) below tmp_path; images are named img-0, img-1, ..."""

    def write(
        images: Sequence[np.ndarray],
        rows: Sequence[str] | None = None,
        header: str = "image,x_m,y_m",
        ending: str = "png",
    ) -> Path:
        for i, image in enumerate(images):
            assert cv2.imwrite(str(tmp_path / f"img-{i}.{ending}"), image)
        if rows is not None:
            (tmp_path / "positions.csv").write_text("\n".join([header, *rows]) + "\n")
        return tmp_path

    return write


@pytest.fixture
def write_grid(write_recording: Write) -> Write:
    """Write a grid of images, row by row; each image is uniform, of the grey value 10 + its number."""

    def write(columns: int = 5, rows: int = 4, step_m: float = 0.5, ending: str = "png") -> Path:
        lines = [
            f"img-{i}.{ending},{i % columns * step_m:.6g},{i // columns * step_m:.6g}" for i in range(columns * rows)
        ]
        images = [np.full((20, 24), 10 + i, np.uint8) for i in range(columns * rows)]
        return write_recording(images, lines, ending=ending)

    return write
