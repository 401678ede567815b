"""Height from how far local features move towards the image's centre."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from omnilab.api import Bytes, Camera, Floats, Heights, Signatures
from omnilab.errors import ConfigError
from omnilab.geometry import wrap_angle
from omnilab.image import view_of
from omnilab_appearance.common.image_pairs import check_pairs
from omnilab_appearance.common.local_features import LocalFeatures, unpacked
from omnilab_appearance.descriptors.sift import Sift
from omnilab_appearance.descriptors.surf import Surf
from omnilab_appearance.distances.features import Features


class Detector(Enum):
    """Which local features."""

    surf = "surf"
    sift = "sift"


@dataclass
class FeatureAltitude:
    """Mean distance by which matching local features lie nearer to the centre, or further off (Berenguer, thesis, 5.3.2).

    Each match tells a rotation, the difference of its ends' azimuths about the centre. The one that most others agree
    with within `tolerance_deg` is taken, as RANSAC would if it had drawn every match; matches that do not agree are
    dropped, the test is turned back, and what is left of each match's distance counts as positive if it leads towards
    the centre. The confidence is the share of the matches that agree. Without any match the height is NaN.
    """

    detector: Detector = Detector.surf  # as printed; or sift
    features: int = 300  # at most so many of each image
    ratio: float = 0.8  # a match is so much nearer than the second best
    tolerance_deg: float = 3.0  # between rotations that agree

    def __post_init__(self) -> None:
        Features(self.ratio)  # checks it
        _ = self._descriptor
        if not 0 < self.tolerance_deg <= 180:
            raise ConfigError(f"tolerance_deg={self.tolerance_deg:g} is none; give degrees above 0 and up to 180")

    def relative(self, references: Bytes, tests: Bytes, camera: Camera) -> Heights:
        """Heights in pixels towards the image's centre."""
        check_pairs(references, tests, camera)
        known, asked = (self._features(view_of(images, camera, "mirror", False)) for images in (references, tests))
        matching = Features(self.ratio)
        found = []
        for i in range(len(tests)):
            k = i if len(references) > 1 else 0
            test, reference = LocalFeatures(*(p[i] for p in asked)), LocalFeatures(*(p[k : k + 1] for p in known))
            matched, partner = matching.matches(test, reference)
            ends = test.xy[matched[0]], reference.xy[0][partner[0, matched[0]]]
            found.append(_moved(*ends, np.deg2rad(self.tolerance_deg)))
        value, confidence, rotation = np.array(found).reshape(-1, 3).T
        return Heights(value, "px", confidence, wrap_angle(rotation))

    @property
    def _descriptor(self) -> Surf | Sift:
        return Surf(self.features) if self.detector is Detector.surf else Sift(self.features)

    def _features(self, views: Bytes) -> LocalFeatures:
        return unpacked(Signatures(self._descriptor.describe(views).place))


def _moved(test_xy: Floats, reference_xy: Floats, tolerance_rad: float) -> tuple[float, float, float]:
    """Mean move towards the centre, share of the matches that count, and rotation, of ends (K, 2) about the centre."""
    if len(test_xy) == 0:
        return np.nan, 0.0, 0.0
    turn = np.arctan2(reference_xy[:, 1], reference_xy[:, 0]) - np.arctan2(test_xy[:, 1], test_xy[:, 0])
    agreeing = np.abs(wrap_angle(turn[:, None] - turn)) <= tolerance_rad
    best = int(agreeing.sum(axis=1).argmax())
    rotation = turn[best] + wrap_angle(turn[agreeing[best]] - turn[best]).mean()
    test_xy, reference_xy = test_xy[agreeing[best]], reference_xy[agreeing[best]]
    cos, sin = np.cos(rotation), np.sin(rotation)
    turned = test_xy @ np.array([[cos, sin], [-sin, cos]])
    inwards = np.sign(np.linalg.norm(reference_xy, axis=1) - np.linalg.norm(test_xy, axis=1))
    moved = inwards * np.linalg.norm(turned - reference_xy, axis=1)
    return float(moved.mean()), len(moved) / len(turn), float(rotation)
