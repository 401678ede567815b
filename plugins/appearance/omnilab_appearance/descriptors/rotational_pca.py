"""Rotational PCA: the eigenspace of rotated panoramas."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from omnilab.api import Bytes, Floats, Ints, Signatures, check_settings, setting
from omnilab.arrays import read_npz
from omnilab.errors import ConfigError, DataError
from omnilab_appearance.common.circular_correlation import Spectra
from omnilab_appearance.common.image_ops import channels_of, with_rows

LARGEST_FILE = 2**31  # bytes
TRAINED = ("mean", "vectors", "frequencies", "singular")
SETTINGS = ("rotations", "rows", "color")  # that the trained arrays depend on


class Projections(Enum):
    """What of the complex projections tells the place (Payá et al., 2016: real in 3.1.2, complex in table 2)."""

    moduli = "moduli"  # which no turn changes
    complex = "complex"  # real and imaginary parts, for images of one heading


@dataclass
class RotationalPca:
    """PCA of all panoramas of the map and all their rotations (Jogan & Leonardis, 2003; Payá et al., 2016, 3.1.2).

    The inner products of N_R rotated copies of each panorama form a block-circulant matrix: a DFT over the rotations
    splits the problem into one small PCA for each frequency of rotation. A rotation by whole steps of 360 / N_R
    degrees multiplies a projection by a phase: `place` holds the projections' moduli (N, components), `heading` the signals with
    these phases (N, rows, N_R), which a rotation shifts. It must be fitted on the map's panoramas before it describes.
    With `projections=complex`, `place` holds their real and imaginary parts, one after the other (N, 2 * components), which a
    rotation changes: for images of one heading.
    """

    components: int = setting(50, at_least=1, at_most=100_000)  # k3, eigenvectors with the largest eigenvalues
    rotations: int = setting(
        64, at_least=2, at_most=8192, multiple_of=2
    )  # N_R, of each panorama; must divide its columns
    rows: int = setting(64, at_least=1, at_most=8192)  # the panoramas are averaged to so many
    color: bool = False  # the channels of RGB, one below the other
    projections: Projections = Projections.moduli  # compared as moduli, or complex
    basis: str | None = None  # a file that Eigenspace.save wrote; null: fitted on the map

    view: ClassVar[str] = "panorama"
    default_distance: ClassVar[str] = "cityblock"

    def __post_init__(self) -> None:
        check_settings(self)

    @property
    def rotation(self) -> str:
        """Turns of the camera change complex projections, and not their moduli."""
        return "invariant" if self.projections is Projections.moduli else "none"

    def fit(self, images: Bytes) -> Eigenspace | RotationalPca:
        """The eigenspace of panoramas (N, H, W[, 3]); with a `basis` there is nothing to fit."""
        if self.basis is not None:
            return self
        spectra = self._spectra(images)
        mean = spectra[..., 0].mean(axis=0)  # of all rotations of all panoramas: it has the frequency 0 alone
        spectra[..., 0] -= mean
        found = []
        for frequency in range(self.rotations // 2 + 1):
            _, singular, vectors = np.linalg.svd(spectra[..., frequency], full_matrices=False)
            found += [(float(s), frequency, v) for s, v in zip(singular[: self.components], vectors, strict=False)]
        kept = sorted(found, key=lambda part: (-part[0], part[1]))[: self.components]
        frequencies = np.array([frequency for _, frequency, _ in kept])
        return Eigenspace(self, mean, np.stack([v for *_, v in kept]), frequencies, np.array([s for s, *_ in kept]))

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> Eigenspace:
        """The eigenspace whose state it was; DataError unless it was fitted with such settings."""
        return Eigenspace.of(state, self, "the map")

    def state(self) -> Mapping[str, npt.NDArray[Any]]:
        """The state of the eigenspace of `basis`."""
        return self._loaded.state()

    def describe(self, images: Bytes) -> Signatures:
        """Signatures in the eigenspace of `basis`; DataError if there is none."""
        if self.basis is None:
            raise DataError(
                "rotational PCA knows no eigenspace yet; fit it on the map's panoramas first, or give a basis"
            )
        return self._loaded.describe(images)

    @cached_property
    def _loaded(self) -> Eigenspace:
        return Eigenspace.load(Path(str(self.basis)), self)

    def _spectra(self, images: Bytes) -> Spectra:
        """The panoramas' parts (N, D, N_R), each multiplied by one phase under a rotation by one step."""
        from scipy import fft

        panoramas = with_rows(channels_of(images, self.color), self.rows)
        columns = panoramas.shape[2]
        if columns % self.rotations:
            raise DataError(f"{self.rotations} rotations do not divide panoramas of {columns} columns; give a divisor")
        spectra = fft.fft(panoramas, norm="ortho").reshape(len(images), -1, self.rotations)
        return np.asarray(spectra, np.complex64)


@dataclass
class Eigenspace:
    """A trained rotational PCA, which describes panoramas as `RotationalPca` says."""

    settings: RotationalPca
    mean: Spectra  # (D,) of the frequency 0
    vectors: Spectra  # (components, D), conjugate
    frequencies: Ints  # (components,) of rotation
    singular: Floats  # (components,) singular values, falling

    view: ClassVar[str] = RotationalPca.view
    default_distance: ClassVar[str] = RotationalPca.default_distance

    @property
    def rotation(self) -> str:
        """What turns of the camera do to signatures."""
        return self.settings.rotation

    @property
    def color(self) -> bool:
        """Whether panoramas are in colour."""
        return self.settings.color

    def describe(self, images: Bytes) -> Signatures:
        """Moduli (N, components), or parts (N, 2 * components), and headings (N, rows, N_R) of panoramas (N, H, W[, 3])."""
        from scipy import fft

        spectra = self.settings._spectra(images)
        if spectra.shape[1] != len(self.mean):
            raise DataError(
                "the panoramas have another size than those the eigenspace was fitted on; describe like ones"
            )
        spectra[..., 0] -= self.mean
        projections = np.empty((len(images), len(self.vectors)), np.complex64)
        for frequency in np.unique(self.frequencies):
            chosen = self.frequencies == frequency
            projections[:, chosen] = spectra[..., frequency] @ self.vectors[chosen].conj().T
        half = np.zeros((len(images), int(self._row.max()) + 1, self.settings.rotations // 2 + 1), np.complex64)
        half[:, self._row, self.frequencies] = projections
        heading = fft.irfft(half, self.settings.rotations)
        place = np.abs(projections)
        if self.settings.projections is Projections.complex:
            place = np.stack([projections.real, projections.imag], axis=-1).reshape(len(images), -1)
        return Signatures(place.astype(np.float32), heading.astype(np.float32))

    @cached_property
    def _row(self) -> Ints:
        """In which row of the headings each component lies: a row holds one component of each frequency."""
        return np.array([np.sum(self.frequencies[:i] == f) for i, f in enumerate(self.frequencies)])

    def state(self) -> Mapping[str, npt.NDArray[Any]]:
        """The trained arrays, and the settings they depend on."""
        arrays = {name: getattr(self, name) for name in TRAINED}
        return arrays | {name: np.array(getattr(self.settings, name)) for name in SETTINGS}

    @classmethod
    def of(cls, state: Mapping[str, npt.NDArray[Any]], settings: RotationalPca, origin: str) -> Eigenspace:
        """The eigenspace whose state it was; DataError, naming the origin, unless it was fitted with such settings."""
        try:
            found = {name: state[name] for name in TRAINED}
            fitted = {name: state[name].item() for name in SETTINGS}
        except (KeyError, ValueError) as error:
            raise DataError(f"{origin} holds no eigenspace ({error}); write one with Eigenspace.save") from None
        for name, value in fitted.items():
            if getattr(settings, name) != value:
                raise ConfigError(
                    f"{origin} was fitted with {name}={value}, not {getattr(settings, name)}; give descriptor.{name}={value}"
                )
        count, size = found["vectors"].shape if found["vectors"].ndim == 2 else (0, 0)
        shapes = {"mean": (size,), "frequencies": (count,), "singular": (count,)}
        if count == 0 or any(found[name].shape != shape for name, shape in shapes.items()):
            raise DataError(f"{origin} holds arrays that do not fit together; write it anew with Eigenspace.save")
        kinds = {"mean": "c", "vectors": "c", "frequencies": "iu", "singular": "f"}
        if not all(found[name].dtype.kind in kinds[name] and np.isfinite(found[name]).all() for name in TRAINED):
            raise DataError(f"{origin} holds NaN, infinity or other types; write it anew with Eigenspace.save")
        if not ((found["frequencies"] >= 0) & (found["frequencies"] <= settings.rotations // 2)).all():
            raise DataError(f"{origin} holds frequencies that no rotations have; write it anew with Eigenspace.save")
        return cls(settings, **found)

    def save(self, path: Path) -> None:
        """Write the eigenspace as a NumPy archive."""
        np.savez(path, allow_pickle=False, **self.state())

    @classmethod
    def load(cls, path: Path, settings: RotationalPca) -> Eigenspace:
        """What `save` wrote; DataError unless it was fitted with such settings."""
        try:
            state = read_npz(path, largest=LARGEST_FILE)
        except (OSError, ValueError) as error:
            reason = error.strerror if isinstance(error, OSError) else error
            raise DataError(f"{path} holds no eigenspace ({reason}); write one with Eigenspace.save") from None
        return cls.of(state, settings, str(path))
