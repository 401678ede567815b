"""Distance of matched local features in two superimposed images."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omnilab.api import Bools, Floats, Ints, Match, Signatures, check_settings, setting
from omnilab.geometry import wrap_angle
from omnilab_appearance.common.local_features import LocalFeatures, unpacked

NEAREST_PX = 0.1  # the least distance of a match, so that 1 / d is finite
APART = 1e6  # of images without a match
HELD = 2**24  # similarities held at once
BINS = 72  # for the vote on the rotation


@dataclass
class Features:
    """1 / sum_i (1 / d_i), d_i the pixels between the two ends of match i (Berenguer, thesis, eq. 4.5).

    The images are superimposed as they are, so this is for cameras of one heading; `features_turned` is for any heading. A
    match passes Lowe's ratio test from the query to the place. Images without a match are 1e6 apart, and ends closer
    than 0.1 pixels count as 0.1. Gives no rotation.
    """

    ratio: float = setting(0.8, above=0, at_most=1)  # of Lowe's test

    derotated: ClassVar[bool] = False  # whether the rotation between the images is undone first

    def __post_init__(self) -> None:
        check_settings(self)

    def prepare(self, places: Signatures) -> LocalFeatures:
        """The places' features."""
        return unpacked(places)

    def match(self, queries: Signatures, index: LocalFeatures) -> Match:
        """Distances (Q, P), and rotations where these are estimated."""
        query = unpacked(queries)
        distance = np.empty((len(queries), len(index.xy)), np.float32)
        rotation = np.zeros_like(distance)
        step = max(1, HELD // (query.xy.shape[1] * index.xy.shape[1]))
        for q in range(len(queries)):
            one = LocalFeatures(*(part[q] for part in query))
            for start in range(0, len(index.xy), step):
                chunk = slice(start, start + step)
                some = LocalFeatures(*(part[chunk] for part in index))
                matched, partner = self.matches(one, some)
                xy = np.take_along_axis(some.xy, partner[..., None], axis=1)  # (places, F, 2): the match's end there
                if self.derotated:
                    rotation[q, chunk] = rotations_by_vote(one.xy, xy, matched)
                distance[q, chunk] = match_distances(one.xy, xy, matched, rotation[q, chunk])
        return Match(distance, wrap_angle(rotation) if self.derotated else None)

    def matches(self, query: LocalFeatures, places: LocalFeatures) -> tuple[Bools, Ints]:
        """Mask of a query's features that are matched in each place (P, F), and indices of the place's features (P, F)."""
        cosine = np.einsum("fd,pgd->pfg", query.vectors, places.vectors, optimize=True)
        cosine = np.where(places.valid[:, None] > 0, cosine, -1)
        partner = cosine.argmax(axis=2)
        best = np.take_along_axis(cosine, partner[..., None], axis=2)
        np.put_along_axis(cosine, partner[..., None], -1, axis=2)
        best_distance, second_distance = (np.sqrt(np.maximum(2 - 2 * c, 0)) for c in (best[..., 0], cosine.max(axis=2)))
        alone = places.valid.sum(axis=1) < 2  # a place with one feature has no second nearest
        matched = (best_distance < self.ratio * second_distance) & ~alone[:, None] & (query.valid > 0)
        return matched, partner


@dataclass
class FeaturesTurned(Features):
    """`features` after undoing the rotation that most matches vote for: for cameras of any heading.

    Each match votes for the difference of its ends' azimuths about the image's centre; the rotation is the mean of the
    votes around the fullest tenth of the histogram.
    """

    derotated: ClassVar[bool] = True


def rotations_by_vote(query_xy: Floats, place_xy: Floats, matched: Bools) -> Floats:
    """Rotations (P,), query heading - place heading, by a vote of the matches of positions (F, 2) and (P, F, 2)."""
    difference = np.arctan2(place_xy[..., 1], place_xy[..., 0]) - np.arctan2(query_xy[:, 1], query_xy[:, 0])
    places, _ = np.nonzero(matched)
    bins = np.floor(np.mod(difference[matched], 2 * np.pi) * BINS / (2 * np.pi)).astype(int) % BINS
    votes = np.zeros((len(place_xy), BINS))
    np.add.at(votes, (places, bins), 1)
    around = sum(np.roll(votes, shift, axis=1) for shift in range(-3, 4))
    middle = (np.asarray(around).argmax(axis=1) + 0.5) * 2 * np.pi / BINS
    off = wrap_angle(difference - middle[:, None])
    close = matched & (np.abs(off) <= 3.5 * 2 * np.pi / BINS)
    mean = np.where(close, off, 0).sum(axis=1) / np.maximum(close.sum(axis=1), 1)
    return np.asarray(np.where(matched.any(axis=1), middle + mean, 0.0))


def match_distances(query_xy: Floats, place_xy: Floats, matched: Bools, rotation_rad: Floats) -> Floats:
    """Distances (P,), 1 / sum_i (1 / d_i), after rotations (P,) of positions (F, 2) were undone."""
    cos, sin = np.cos(rotation_rad)[:, None], np.sin(rotation_rad)[:, None]
    x, y = query_xy[:, 0], query_xy[:, 1]
    rotated = np.stack([cos * x - sin * y, sin * x + cos * y], -1)
    closeness = 1 / np.maximum(np.linalg.norm(rotated - place_xy, axis=-1), NEAREST_PX)
    total = np.where(matched, closeness, 0).sum(axis=1)
    return np.asarray(np.divide(1.0, total, out=np.full(len(total), APART), where=total > 0))
