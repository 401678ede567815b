"""Rotation by matched features of the sphere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Bools, Floats, Ints, Match, Signatures, check_settings, setting
from omnilab.errors import DataError
from omnilab.geometry import wrap_angle
from omnilab_appearance.common.ray_rotation import robust_rotation

UNIT = 1e-3  # how far a direction's length may be from 1


@dataclass
class FeatureRotation:
    """1 minus the share of features that one rotation of the sphere matches, in [0, 1], for `spherical_sift`.

    Mutual nearest neighbours that pass Lowe's ratio test are matches; RANSAC and Wahba's problem give the rotation. Between
    two places directions differ by parallax too, of which the rotation is what agrees within `tolerance_deg`.
    Of a query, the `verified` places with most matches are looked at; the others are at distance 1, rotation none.
    """

    ratio: float = setting(0.85, above=0, at_most=1)  # of Lowe's test
    tolerance_deg: float = setting(4.0, above=0, at_most=45)  # of a match from where the rotation takes it
    draws: int = setting(300, at_least=1, at_most=1_000_000)  # of RANSAC
    verified: int = setting(5, at_least=1)  # places of each query
    seed: int = setting(0, at_least=0, at_most=2**63 - 1)  # of RANSAC

    def __post_init__(self) -> None:
        check_settings(self)

    def prepare(self, places: Signatures) -> list[Floats]:
        """The features (F, 3 + D) of each place, without padding."""
        if not _holds_directions(places.place):
            raise DataError(
                f"signatures of shape {places.place.shape[1:]} hold no features of the sphere; choose"
                " descriptor=spherical_sift, or another distance"
            )
        return [one[np.abs(one[:, :3]).sum(axis=1) > 0] for one in places.place]

    def match(self, queries: Signatures, index: list[Floats]) -> Match:
        """Distances (Q, P), headings (Q, P) and rotations (Q, P, 3, 3)."""
        distance = np.ones((len(queries), len(index)), np.float32)
        rotation = np.tile(np.eye(3), (*distance.shape, 1, 1))
        for q, query in enumerate(self.prepare(queries)):
            matches = [mutual_matches(place[:, 3:], query[:, 3:], self.ratio) for place in index]
            for p in np.argsort([-len(i) for i, _ in matches], kind="stable")[: self.verified]:
                i, j = matches[p]
                rotation[q, p], agree = self.rotation(index[p][i, :3], query[j, :3])
                distance[q, p] = 1 - agree.sum() / max(1, min(len(query), len(index[p])))
        heading = np.arctan2(rotation[..., 1, 0] - rotation[..., 0, 1], rotation[..., 0, 0] + rotation[..., 1, 1])
        return Match(distance, wrap_angle(heading).astype(np.float32), rotation)

    def rotation(self, place: Floats, query: Floats) -> tuple[Floats, Bools]:
        """R_place_query (3, 3) of matched directions (M, 3), and which agree."""
        rng = np.random.default_rng(self.seed)
        return robust_rotation(
            place.astype(float), query.astype(float), rng, np.deg2rad(self.tolerance_deg), self.draws
        )


def mutual_matches(place: Floats, query: Floats, ratio: float) -> tuple[Ints, Ints]:
    """Indices (M,), (M,) of unit vectors (F, D), (G, D) that are each other's nearest and pass Lowe's ratio test."""
    if len(place) < 2 or len(query) < 2:
        return np.zeros(0, int), np.zeros(0, int)
    cosine = place @ query.T
    rows, partner = np.arange(len(place)), cosine.argmax(axis=1)
    mutual = cosine.argmax(axis=0)[partner] == rows
    two = np.partition(cosine, -2, axis=1)[:, -2:]
    apart = np.sqrt(np.maximum(2 - 2 * two, 0))
    chosen = np.flatnonzero(mutual & (apart[:, 1] < ratio * apart[:, 0]))
    return chosen, partner[chosen]


def _holds_directions(signatures: Floats) -> bool:
    """Whether they are features (N, F, 3 + D) of unit directions, or of zeros where there is none."""
    if signatures.ndim != 3 or signatures.shape[2] < 4:
        return False
    length = np.linalg.norm(signatures[..., :3], axis=-1)
    return bool(((np.abs(length - 1) < UNIT) | (length == 0)).all())
