"""What all components on a device have in common: arrays there and back, images in blocks of one size, memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch

from omnilab.api import Array, Bytes
from omnilab_appearance.common.circular_correlation import Headings

BLOCK = 32  # images at once
HELD = 2**26  # numbers held at once: 256 MB of single precision

Tensor = Any  # of torch, which may not be installed where types are checked


class OnDevice:
    """A component that computes on a device of torch."""

    device: Any  # a torch.device; it is no setting

    def there(self, array: Array) -> Tensor:
        """A copy on the device. What the runner gives is read-only, so it is copied first."""
        return torch.tensor(np.ascontiguousarray(array), device=self.device)

    def headings_there(self, headings: Headings | None) -> Headings | None:
        """The spectra of a map's headings on the device."""
        return None if headings is None else Headings(self.there(headings.spectra), headings.samples)

    def in_blocks(self, compute: Callable[[Tensor], tuple[Tensor, ...]], images: Bytes) -> tuple[Array, ...]:
        """What `compute` makes of images (N, H, W), float32 there, in arrays of N rows.

        All blocks are of one size, the last filled up with black: libraries choose their algorithm by the size of a batch,
        and what an image is described as must not depend on how many others there are.
        """
        rows: list[tuple[Array, ...]] = []
        with memory_as_usual():
            for start in range(0, max(1, len(images)), BLOCK):
                some = images[start : start + BLOCK]
                block = np.zeros((BLOCK, *images.shape[1:]), np.uint8)
                block[: len(some)] = some
                made = compute(self.there(block).to(torch.float32))
                rows.append(tuple(here(part)[: len(some)] for part in made))
        return tuple(np.concatenate(parts) for parts in zip(*rows, strict=True))


def here(tensor: Tensor) -> Array:
    """A tensor as an array of NumPy, in C order."""
    return np.ascontiguousarray(tensor.cpu().numpy())


@contextmanager
def memory_as_usual() -> Iterator[None]:
    """A device without enough memory raises what a machine does."""
    try:
        yield
    except torch.OutOfMemoryError as error:
        raise MemoryError(f"on the device: {str(error).partition('. ')[0]}") from error
