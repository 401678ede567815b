"""A descriptor: how much the panorama changes from column to column, in cells."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from omnilab import (
    Bytes,
    Descriptor,
    Signatures,
    check_settings,
    setting,
)


@dataclass
class MyDescriptor:
    """Edges of the panorama: differences of neighbouring columns, averaged over cells.

    Unlike grey levels they do not notice that all of an image is brighter. Signatures
    are (N, rows, columns), in grey levels; a rotation of the camera shifts the columns.
    """

    rows: int = setting(8, at_least=1, at_most=128)  # of cells
    columns: int = setting(64, at_least=4, at_most=512)  # of cells, over 360 degrees

    view: ClassVar[str] = "panorama"  # or "mirror", "sphere": what `describe` is given
    color: ClassVar[bool] = False  # whether it wants RGB
    rotation: ClassVar[str] = "equivariant"  # or "invariant", "none"
    default_distance: ClassVar[str] = "poc"  # that compares them, if none is named

    def __post_init__(self) -> None:
        check_settings(self)

    def describe(self, images: Bytes) -> Signatures:
        """Cells (N, rows, columns) float32 of panoramas (N, H, W) uint8."""
        levels = images.astype(np.int16)  # uint8 would wrap around
        values = np.abs(np.roll(levels, -1, axis=2) - levels)  # all around
        for axis, count in (1, self.rows), (2, self.columns):
            cells = np.array_split(values, count, axis)
            values = np.stack([cell.mean(axis) for cell in cells], axis)
        return Signatures(values.astype(np.float32))


# a type checker compares it with the contract:
_: type[Descriptor] = MyDescriptor
