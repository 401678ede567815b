"""Distances on a device: the spectra of signatures are the CPU's own, all pairs are compared there, in blocks."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np
import torch

from omnilab.api import Floats, Signatures
from omnilab_appearance.accelerated.on_device import HELD, OnDevice, Tensor, here, memory_as_usual
from omnilab_appearance.common.circular_correlation import Headings, Spectra, headings_of, refined, synthesis
from omnilab_appearance.distances.cosine import Cosine
from omnilab_appearance.distances.euclidean import Euclidean
from omnilab_appearance.distances.pearson import Pearson
from omnilab_appearance.distances.poc import CHUNK, Poc, matrices_of, unit_phase
from omnilab_appearance.distances.poc_band import PocBand
from omnilab_appearance.distances.vector_distance import VectorDistance, VectorIndex
from omnilab_appearance.distances.weighted import Cityblock


class RotationsOnDevice(OnDevice):
    """Finds rotations there."""

    def _best_rotations(self, queries: Spectra, places: Tensor, samples: int) -> tuple[Floats, Floats]:
        """`best_rotations` of spectra (Q, rows, frequencies), and (frequencies, rows, P) on the device."""
        found = np.empty((4, len(queries), places.shape[2]), np.float32)
        step = max(1, HELD // (max(1, len(queries)) * samples))
        with memory_as_usual():
            band = self.there(queries.conj().transpose(2, 0, 1))
            inverse = self.there(synthesis(len(places), samples))
            for start in range(0, places.shape[2], step):
                cross = band @ places[:, :, start : start + step]
                curves = torch.cat([cross.real, cross.imag]).flatten(1).T @ inverse
                found[:, :, start : start + step] = here(_around_peaks(curves)).reshape(4, len(queries), -1)
        agreement, shift = refined(*found)
        return agreement, np.asarray(2 * np.pi / samples * shift, np.float32)


def _around_peaks(curves: Tensor) -> Tensor:
    """Of curves (N, samples), which go round: the sample before the highest, that, the next, and its number, (4, N)."""
    top = curves.argmax(1)  # the first, where there are several
    before, peak, after = (curves.gather(1, ((top + by) % curves.shape[1])[:, None])[:, 0] for by in (-1, 0, 1))
    return torch.stack([before, peak, after, top.to(curves.dtype)])


class VectorsOnDevice(RotationsOnDevice, VectorDistance):
    """A distance between vectors, of which the places stay on the device."""

    def prepare(self, places: Signatures) -> VectorIndex:
        index = super().prepare(places)
        with memory_as_usual():
            fitted = index.places if isinstance(index.places, tuple) else (index.places,)
            there = tuple(self.there(each) for each in fitted)
            return index._replace(places=there, headings=self.headings_there(index.headings))

    def _distances(self, queries: Floats, places: Any) -> Floats:
        """Blocks of bounded memory."""
        count = len(places[-1])
        found = np.empty((len(queries), count), np.float32)
        step = max(1, HELD // max(1, len(queries)))
        with memory_as_usual():
            there = self.there(queries)
            for start in range(0, count, step):
                found[:, start : start + step] = here(self._block(there, places, slice(start, start + step)))
        return found

    @abstractmethod
    def _block(self, queries: Tensor, places: tuple[Tensor, ...], some: slice) -> Tensor:
        """Distances (Q, P) from some of the places, by what `_fit` made of them."""


class CityblockOnTorch(VectorsOnDevice, Cityblock):
    """`cityblock` there."""

    def _block(self, queries: Tensor, places: tuple[Tensor, ...], some: slice) -> Tensor:
        return torch.cdist(queries, places[0][some], p=1.0)


class EuclideanOnTorch(VectorsOnDevice, Euclidean):
    """`euclidean` there."""

    def _block(self, queries: Tensor, places: tuple[Tensor, ...], some: slice) -> Tensor:
        mean, centred_places, squares = places
        centred = queries - mean
        product = centred @ centred_places[some].T
        return ((centred * centred).sum(1)[:, None] + squares[some] - 2 * product).clamp_min(0).sqrt()


class CosineOnTorch(VectorsOnDevice, Cosine):
    """`cosine` there."""

    def _block(self, queries: Tensor, places: tuple[Tensor, ...], some: slice) -> Tensor:
        return 1 - _unit(queries) @ places[0][some].T


class PearsonOnTorch(VectorsOnDevice, Pearson):
    """`pearson` there."""

    def _block(self, queries: Tensor, places: tuple[Tensor, ...], some: slice) -> Tensor:
        return 1 - _unit(queries - queries.mean(1, keepdim=True)) @ places[0][some].T


def _unit(vectors: Tensor) -> Tensor:
    length = torch.linalg.vector_norm(vectors, dim=1, keepdim=True)
    return torch.where(length > 0, vectors / length, torch.zeros_like(vectors))


class PocBandOnTorch(RotationsOnDevice, PocBand):
    """`poc_band` there."""

    def prepare(self, places: Signatures) -> tuple[Tensor, int, Headings | None]:
        spectra, angles, headings = super().prepare(places)
        with memory_as_usual():
            return self.there(spectra), angles, self.headings_there(headings)


class PocOnTorch(RotationsOnDevice, Poc):
    """`poc` there: the surfaces by inverse Fourier transforms, in batches."""

    def prepare(self, places: Signatures) -> tuple[Any, int, Headings | None]:
        matrices = matrices_of(places)
        with memory_as_usual():
            chunks = [self.there(unit_phase(matrices[i : i + CHUNK])) for i in range(0, len(matrices), CHUNK)]
            return torch.cat(chunks), matrices.shape[2], self.headings_there(headings_of(places))

    def _peaks(self, queries: Spectra, places: Tensor, columns: int) -> Floats:
        found = np.empty((4, len(queries), len(places)), np.float32)
        rows = places.shape[1]
        step = max(1, HELD // (4 * rows * columns))
        with memory_as_usual():
            for q, query in enumerate(self.there(queries.conj())):
                for start in range(0, len(places), step):
                    surfaces = torch.fft.irfft2(places[start : start + step] * query, s=(rows, columns))
                    found[:, q, start : start + step] = here(_highest(surfaces))
        return found


def _highest(surfaces: Tensor) -> Tensor:
    """`_peaks` of surfaces (P, rows, columns)."""
    row = surfaces.amax(2).argmax(1)
    curves = surfaces[torch.arange(len(surfaces), device=surfaces.device), row]
    before, peak, after, top = _around_peaks(curves)
    return torch.stack([peak, before, after, top])
