from dataclasses import dataclass

import numpy as np

from omnilab import Signatures, hookimpl


@dataclass
class Tiny:
    """The panorama as a tiny image: grey levels averaged over cells (Torralba et al., 2008)."""

    rows: int = 8  # of the tiny image
    columns: int = 32  # of the tiny image, over 360 degrees
    view, color, rotation, default_distance = "panorama", False, "equivariant", "poc"

    def describe(self, images):
        for axis, cells in (1, self.rows), (2, self.columns):
            images = np.stack([cell.mean(axis) for cell in np.array_split(images, cells, axis)], axis)
        return Signatures(images.astype(np.float32))


@hookimpl
def register_descriptors(register):
    register("tiny", Tiny)
