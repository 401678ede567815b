"""Altitude from the radial displacement of matched local features."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Bools, Bytes, Camera, Floats, Heights, Signatures, check_settings, setting
from omnilab.errors import ConfigError
from omnilab.geometry import wrap_angle
from omnilab.image import view_of
from omnilab_appearance.common.image_pairs import check_pairs
from omnilab_appearance.common.local_features import Detector, LocalFeatures, unpacked
from omnilab_appearance.descriptors.sift import Sift
from omnilab_appearance.descriptors.surf import Surf
from omnilab_appearance.distances.features import Features


@dataclass
class FeatureAltitude:
    """Mean displacement of matched local features towards the image's centre (Berenguer, thesis, 5.3.2).

    Each match gives a rotation, the difference of its ends' azimuths about the centre. The one with the most inliers
    within `tolerance_deg` is taken, as by RANSAC over every match; outliers are dropped, the rotation of the test is
    undone, and the remaining distance of each match counts as positive if it leads towards the centre. The
    confidence is the share of inliers. Without any match the height is NaN.
    """

    detector: Detector = Detector.surf  # as printed; or sift
    features: int = setting(300, at_least=1, at_most=10_000)  # at most so many of each image
    ratio: float = setting(0.8, above=0, at_most=1)  # of Lowe's test
    tolerance_deg: float = setting(3.0, above=0, at_most=180)  # between rotations of inliers

    def __post_init__(self) -> None:
        check_settings(self)
        if self.detector not in {Detector.surf, Detector.sift}:
            raise ConfigError(f"detector={self.detector.value} is of odometries; give surf or sift")
        _ = self._descriptor

    def relative(self, references: Bytes, tests: Bytes, camera: Camera) -> Heights:
        """Heights in pixels towards the image's centre."""
        check_pairs(references, tests, camera)
        known, queried = (self._features(view_of(images, camera, "mirror", False)) for images in (references, tests))
        matching = Features(self.ratio)
        found = []
        for i in range(len(tests)):
            k = i if len(references) > 1 else 0
            test, reference = LocalFeatures(*(p[i] for p in queried)), LocalFeatures(*(p[k : k + 1] for p in known))
            matched, partner = matching.matches(test, reference)
            ends = test.xy[matched[0]], reference.xy[0][partner[0, matched[0]]]
            found.append(radial_displacement(*ends, np.deg2rad(self.tolerance_deg)))
        value, confidence, rotation = np.array(found).reshape(-1, 3).T
        return Heights(value, "px", confidence, wrap_angle(rotation))

    @property
    def _descriptor(self) -> Surf | Sift:
        return Surf(self.features) if self.detector is Detector.surf else Sift(self.features)

    def _features(self, views: Bytes) -> LocalFeatures:
        return unpacked(Signatures(self._descriptor.describe(views).place))


def radial_displacement(test_xy: Floats, reference_xy: Floats, tolerance_rad: float) -> tuple[float, float, float]:
    """Mean displacement towards the centre, share of inliers, and rotation, of ends (K, 2) about the centre."""
    if len(test_xy) == 0:
        return np.nan, 0.0, 0.0
    rotation, agreeing = common_rotation(test_xy, reference_xy, tolerance_rad)
    test_xy, reference_xy = test_xy[agreeing], reference_xy[agreeing]
    inwards = np.sign(np.linalg.norm(reference_xy, axis=1) - np.linalg.norm(test_xy, axis=1))
    moved = inwards * np.linalg.norm(derotated(test_xy, rotation) - reference_xy, axis=1)
    return float(moved.mean()), len(moved) / len(agreeing), rotation


def common_rotation(test_xy: Floats, reference_xy: Floats, tolerance_rad: float) -> tuple[float, Bools]:
    """The rotation of the test that most matches, ends (K, 2) about the centre, agree with, and which (K,) do."""
    difference = np.arctan2(reference_xy[:, 1], reference_xy[:, 0]) - np.arctan2(test_xy[:, 1], test_xy[:, 0])
    agreeing = np.abs(wrap_angle(difference[:, None] - difference)) <= tolerance_rad
    best = int(agreeing.sum(axis=1).argmax())
    rotation = difference[best] + wrap_angle(difference[agreeing[best]] - difference[best]).mean()
    return float(rotation), agreeing[best]


def derotated(xy: Floats, rotation_rad: float) -> Floats:
    """Points (K, 2) turned about the centre."""
    cos, sin = np.cos(rotation_rad), np.sin(rotation_rad)
    return np.asarray(xy @ np.array([[cos, sin], [-sin, cos]]))
