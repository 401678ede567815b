"""Gabor filter banks on images whose last axis wraps around."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from omnilab.api import Floats

REACH = 3.0  # standard deviations at which a filter ends
CHUNK = 16  # images filtered at once


def kernel(frequency: float, orientation_rad: float) -> Floats:
    """A complex Gabor filter (k, k) with a bandwidth of one octave (Petkov & Kruizinga, 1997); its Gaussian sums to 1.

    `frequency` in cycles per sample along `orientation_rad`, counted from the columns' axis to the rows'.
    """
    sigma = np.sqrt(np.log(2) / 2) * 3 / (np.pi * frequency)
    reach = int(np.ceil(REACH * sigma))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1].astype(float)
    along = x * np.cos(orientation_rad) + y * np.sin(orientation_rad)
    envelope = np.exp(-0.5 * (x**2 + y**2) / sigma**2) / (2 * np.pi * sigma**2)
    return np.asarray(envelope * np.exp(2j * np.pi * frequency * along))


def energies(images: Floats, orientations: int, frequency: float) -> Floats:
    """Gabor energies: moduli (N, M, H, W) of the responses of images (N, H, W) to M filters, evenly over 180 degrees.

    The last axis wraps around; the other is continued by reflection.
    """
    from scipy import fft

    height, width = images.shape[1:]
    filters, margin = transfer_functions(height, width, orientations, frequency)
    found = np.empty((len(images), orientations, height, width), np.float32)
    for start in range(0, len(images), CHUNK):
        padded = np.pad(images[start : start + CHUNK], ((0, 0), (margin, margin), (0, 0)), mode="symmetric")
        spectra = fft.fft2(padded.astype(np.float32), workers=-1)
        for m, transfer in enumerate(filters):
            response = fft.ifft2(spectra * transfer, workers=-1)
            found[start : start + CHUNK, m] = np.abs(response[:, margin : margin + height])
    return found


@lru_cache(maxsize=16)
def transfer_functions(height: int, width: int, orientations: int, frequency: float) -> tuple[Floats, int]:
    """The filters' transfer functions (M, H + 2 margin, W), and the margin."""
    kernels = [kernel(frequency, np.pi * m / orientations) for m in range(orientations)]
    reach = len(kernels[0]) // 2
    margin = min(reach, height)
    transfers = np.zeros((orientations, height + 2 * margin, width), np.complex128)
    rows, columns = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    for transfer, values in zip(transfers, kernels, strict=True):
        np.add.at(transfer, (rows % transfer.shape[0], columns % width), values)  # a narrow image is gone round twice
    return np.fft.fft2(transfers).astype(np.complex64), margin


def halved(images: Floats) -> Floats:
    """Images (N, H, W), low-passed by a Gaussian and subsampled by 2; the last axis wraps around."""
    import cv2

    wrapped = np.pad(np.pad(images, ((0, 0), (0, 0), (3, 3)), mode="wrap"), ((0, 0), (3, 3), (0, 0)), mode="symmetric")
    soft = [cv2.GaussianBlur(image, (7, 7), 1.0)[3:-3:2, 3:-3:2] for image in wrapped]
    return np.stack(soft)
