"""Tiny image of the panorama."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omnilab.api import Bytes, Signatures, check_settings, setting
from omnilab.errors import DataError
from omnilab_appearance.common.image_ops import channels_of, side_by_side


@dataclass
class TinyImage:
    """The panorama averaged down to some pixels (Torralba et al., 2008): the cheapest baseline.

    Signatures are (N, rows, columns), and a rotation of the camera shifts the columns.
    """

    rows: int = setting(16, at_least=1, at_most=8192)  # of the tiny image
    columns: int = setting(32, at_least=1, at_most=8192)  # of the tiny image, over 360 degrees
    color: bool = False  # each channel of RGB for itself

    view: ClassVar[str] = "panorama"
    rotation: ClassVar[str] = "equivariant"
    default_distance: ClassVar[str] = "poc_band"

    def __post_init__(self) -> None:
        check_settings(self)

    def describe(self, images: Bytes) -> Signatures:
        """Tiny images (N, rows, columns) of panoramas (N, H, W[, 3])."""
        import cv2

        panoramas = channels_of(images, self.color)
        if self.rows > panoramas.shape[1] or self.columns > panoramas.shape[2]:
            raise DataError(
                f"panoramas of {panoramas.shape[1]} x {panoramas.shape[2]} are smaller than {self.rows} x {self.columns};"
                " give fewer rows and columns"
            )
        size = (self.columns, self.rows)
        tiny = [cv2.resize(panorama.astype(np.float32), size, interpolation=cv2.INTER_AREA) for panorama in panoramas]
        return side_by_side(Signatures(np.stack(tiny)), self.color)
