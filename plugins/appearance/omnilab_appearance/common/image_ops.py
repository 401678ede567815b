"""Image operations that descriptors share: channels, resampled rows, blocks."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np

from omnilab.api import Bytes, Floats, Ints, Signatures
from omnilab.errors import DataError


def channels_of(images: Bytes, color: bool) -> Bytes:
    """Grey images (N, H, W), or all channels of colour ones (N, H, W, 3) as (3 N, H, W); DataError for others."""
    if images.ndim != (4 if color else 3) or images.dtype != np.uint8:
        wanted = "(N, H, W, 3)" if color else "(N, H, W)"
        raise DataError(f"images of shape {images.shape} and type {images.dtype} were given; give {wanted} uint8")
    return images if not color else np.ascontiguousarray(np.moveaxis(images, -1, 1)).reshape(-1, *images.shape[1:3])


def side_by_side(signatures: Signatures, color: bool) -> Signatures:
    """Signatures of channels (3 N, ...) as those of colour images: the three are stacked along the first axis."""
    if not color:
        return signatures
    return Signatures(_stacked(signatures.place), None if signatures.heading is None else _stacked(signatures.heading))


def _stacked(parts: Floats) -> Floats:
    return parts.reshape(len(parts) // 3, 3 * parts.shape[1], *parts.shape[2:])


def with_rows(images: Bytes, rows: int) -> Floats:
    """Panoramas (N, rows, W) float32, each row the mean of those it covers."""
    import cv2

    check_rows(rows, images.shape[1])
    fine = images.astype(np.float32)
    if rows == images.shape[1]:
        return fine
    size = (images.shape[2], rows)
    return np.stack([cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in fine])


def check_rows(rows: int, height: int) -> None:
    """DataError if panoramas are to have more rows than they have."""
    if rows > height:
        raise DataError(f"rows={rows} are more than the {height} rows of the panoramas; give fewer")


def resized(panoramas: Bytes, rows: int, columns: int) -> Floats:
    """Panoramas (N, rows, columns) float32, averaged down over areas; DataError for smaller ones."""
    import cv2

    if rows > panoramas.shape[1] or columns > panoramas.shape[2]:
        raise DataError(
            f"panoramas of {panoramas.shape[1]} x {panoramas.shape[2]} are smaller than {rows} x {columns};"
            " give fewer rows and columns"
        )
    size = (columns, rows)
    return np.stack([cv2.resize(image.astype(np.float32), size, interpolation=cv2.INTER_AREA) for image in panoramas])


def smoothed(panoramas: Floats, sigma: float) -> Floats:
    """Panoramas (N, H, W) convolved with a Gaussian of `sigma` pixels; the last axis wraps, the other is reflected."""
    from scipy.ndimage import gaussian_filter1d

    if sigma == 0:
        return panoramas
    return np.asarray(gaussian_filter1d(gaussian_filter1d(panoramas, sigma, 2, mode="wrap"), sigma, 1, mode="reflect"))


def bands(count: int, length: int) -> list[slice]:
    """`count` contiguous slices of `length` samples, as even as possible; DataError if `count` is above `length`."""
    if count > length:
        raise DataError(f"{count} blocks cannot be cut from {length} rows; give at most {length}")
    edges = np.round(np.linspace(0, length, count + 1)).astype(int)
    return [slice(int(low), int(high)) for low, high in pairwise(edges)]


def band_edges(count: int, length: int) -> Ints:
    """Where `bands` begin, and the end of the last one: (count + 1)."""
    return np.array([0, *(band.stop for band in bands(count, length))])


def band_means(values: Floats, count: int) -> Floats:
    """Means (N, K, count, W) over `count` bands of the rows of (N, K, H, W)."""
    return np.stack([values[:, :, band].mean(axis=2) for band in bands(count, values.shape[2])], 2)


def columns_around(values: Floats, width: int, spacing: int) -> Floats:
    """Means over overlapping windows of the last axis, which wraps: (..., W) to (..., W / spacing).

    Window k is `width` samples wide and begins at k x spacing.
    """
    samples = values.shape[-1]
    if width > samples or samples % spacing:
        raise DataError(
            f"blocks {width} wide every {spacing} columns do not fit {samples} columns;"
            f" give a width up to {samples} and a spacing that divides it"
        )
    sums = np.cumsum(np.concatenate([values, values[..., :width]], -1), -1, dtype=np.float64)
    sums = np.concatenate([np.zeros_like(sums[..., :1]), sums], -1)
    starts = np.arange(0, samples, spacing)
    return np.asarray((sums[..., starts + width] - sums[..., starts]) / width, np.float32, order="C")


def shrunk(image: Bytes, size: int) -> Floats:
    """A square picture (S, S) of at least `size` pixels a side, averaged over size x size cells: (size, size) float32.

    As OpenCV's INTER_AREA has it, to the last bit.
    """
    import cv2

    from omnilab_appearance.common.kernels import cell_averages

    side = len(image)
    if side % size == 0:  # cells of whole pixels, which OpenCV adds up in another order
        return np.asarray(cv2.resize(image.astype(np.float32), (size, size), interpolation=cv2.INTER_AREA))
    at, weights, starts = _cells(side, size)
    lanes = -(-int(np.diff(starts).max()) // 8) * 8
    columns = np.zeros((side, side + lanes), image.dtype)
    cv2.transpose(image, columns[:, :side])
    out = np.empty((size, size), np.float32)
    cell_averages(columns, at, weights, starts, lanes, out)
    return out


@lru_cache(maxsize=8)
def _cells(side: int, size: int) -> tuple[Ints, Floats, Ints]:
    """Pixels (K,) of `size` cells of a row of `side`, the shares of its cell that they cover, and where each cell starts."""
    width = side / size
    edges = np.arange(size + 1) * width
    first, last = np.floor(edges[:-1] + 1e-3).astype(int), np.ceil(edges[1:] - 1e-3).astype(int).clip(max=side)
    starts = np.concatenate([[0], np.cumsum(last - first)])
    cell = np.repeat(np.arange(size), last - first)
    at = np.arange(starts[-1]) - starts[cell] + first[cell]
    high = edges[:-1] + width
    covered = np.minimum(at + 1, high[cell]) - np.maximum(at, edges[cell])
    return at, (covered / np.minimum(width, side - edges[cell])).astype(np.float32), starts
