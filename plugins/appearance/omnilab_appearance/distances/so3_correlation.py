"""Correlation over all rotations of the sphere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Match, Signatures, check_settings, setting
from omnilab.errors import DataError
from omnilab.geometry import wrap_angle
from omnilab_appearance.common.so3_correlation import betas_of
from omnilab_appearance.common.sphere_registration import PARTS, peaks, refined
from omnilab_appearance.common.spherical_harmonics import Complexes, unpacked_of


@dataclass
class So3Correlation:
    """1 minus the highest normalised correlation of two spheres over all rotations, in [0, 2] (Makadia and Daniilidis, 2006).

    For `spherical_harmonics`. The correlation is computed by Fourier transforms on SO(3) at rotations 180 / band_limit
    degrees apart, of which those count that tilt one camera's z axis against the other's by at most `largest_tilt_deg`:
    less is faster, and what cannot be is not answered. Where both cameras see a part of the sphere, it is Pearson's over
    what both see, at least `least_overlap` of the smaller part. For the nearest `refined` places of each query the peak
    is refined between the rotations of the grid; for the others distance and rotation are those of the grid.
    """

    largest_tilt_deg: float = setting(180.0, at_least=0, at_most=180)
    refined: int = setting(1, at_least=0)  # places of each query
    least_overlap: float = setting(0.5, above=0, at_most=1)

    def __post_init__(self) -> None:
        check_settings(self)

    def prepare(self, places: Signatures) -> Complexes:
        """Complex coefficients (P, 3, L, 2 L - 1) of the places."""
        coefficients = places.place
        limit = round(coefficients.shape[-1] ** 0.5)
        if coefficients.ndim != 3 or coefficients.shape[1] != PARTS or limit**2 != coefficients.shape[2] or limit < 2:
            raise DataError(
                f"signatures of shape {coefficients.shape[1:]} are no spherical harmonics; choose"
                " descriptor=spherical_harmonics, or another distance"
            )
        return unpacked_of(coefficients.astype(float))

    def match(self, queries: Signatures, index: Complexes) -> Match:
        """Distances (Q, P), headings (Q, P) and rotations (Q, P, 3, 3)."""
        spheres = self.prepare(queries)
        if spheres.shape[1:] != index.shape[1:]:
            raise DataError(
                f"queries of band limit {spheres.shape[2]} cannot be compared with places of {index.shape[2]}; describe"
                " both with the same settings"
            )
        largest = float(np.deg2rad(self.largest_tilt_deg))
        betas = betas_of(spheres.shape[2], largest)
        correlation = np.empty((len(queries), len(index)))
        rotation = np.empty((len(queries), len(index), 3, 3))
        for q, sphere in enumerate(spheres):
            correlation[q], turned = peaks(sphere, index, betas, self.least_overlap)
            rotation[q] = np.swapaxes(turned, -1, -2)  # from the query's frame to the place's
            for p in np.argsort(-correlation[q], kind="stable")[: self.refined]:
                step = np.pi / (2 * spheres.shape[2])
                value, R = refined(sphere, index[p], rotation[q, p].T, step, self.least_overlap, largest)
                correlation[q, p], rotation[q, p] = value, R.T
        heading = np.arctan2(rotation[..., 1, 0] - rotation[..., 0, 1], rotation[..., 0, 0] + rotation[..., 1, 1])
        return Match((1 - correlation).astype(np.float32), wrap_angle(heading).astype(np.float32), rotation)
