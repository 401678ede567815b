"""SIFT features of the whole sphere, as directions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omnilab.api import Bools, Bytes, Floats, Signatures, check_settings, setting
from omnilab.cameras import EquirectangularCamera, reproject
from omnilab_appearance.common.image_ops import channels_of
from omnilab_appearance.common.vectors import unit

BELTS = (
    np.eye(3),
    np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
)  # R_sphere_belt: poles up, and poles ahead and behind
WIDEST_RAD = np.deg2rad(45.0)  # of a belt, where a picture stretches by 1.4; the second has what is steeper
DIMENSIONS = 128
WRAP = 24  # columns repeated on either side, so that features on the seam are found


@dataclass
class SphericalSift:
    """SIFT features of the whole sphere (Lowe, 2004): (N, features, 3 + 128), a unit direction and a unit vector each.

    They are found on two equirectangular pictures, of which the second has its poles on the first one's equator, so that
    none lies where a picture is stretched by more than 1.4. Rows of padding are zero. For `epipolar_rotation` and
    `feature_rotation`.
    """

    features: int = setting(400, at_least=1, at_most=10_000)  # at most so many of each image, strongest first
    contrast: float = setting(0.02, above=0)  # detection threshold

    view: ClassVar[str] = "sphere"
    color: ClassVar[bool] = False
    rotation: ClassVar[str] = "none"  # of the last axis; the distance finds it
    default_distance: ClassVar[str] = "epipolar_rotation"

    def __post_init__(self) -> None:
        check_settings(self)

    def describe(self, images: Bytes) -> Signatures:
        """Features of spheres (N, H, 2 H), 0 where nothing is seen."""
        place = np.zeros((len(images), self.features, 3 + DIMENSIONS), np.float32)
        for rows, picture in zip(place, channels_of(images, self.color), strict=True):
            found = [self._of_belt(picture, R, steep) for R, steep in zip(BELTS, (False, True), strict=True)]
            response, features = (np.concatenate(parts) for parts in zip(*found, strict=True))
            strongest = np.argsort(-response, kind="stable")[: self.features]
            rows[: len(strongest)] = features[strongest]
        return Signatures(place)

    def _of_belt(self, picture: Bytes, R_sphere_belt: Floats, steep: bool) -> tuple[Floats, Floats]:
        """Responses (K,) and features (K, 3 + 128) of the sphere within 45 degrees of its equator, or beyond."""
        import cv2

        camera = EquirectangularCamera(picture.shape[1], picture.shape[0])
        belt = reproject(picture[None], camera, camera, R_sphere_belt)[0] if steep else picture
        wrap = min(WRAP, belt.shape[1])
        wide = np.concatenate([belt[:, -wrap:], belt, belt[:, :wrap]], axis=1)
        detector = cv2.SIFT_create(contrastThreshold=self.contrast, enable_precise_upscale=True)  # type: ignore[attr-defined]
        points, vectors = detector.detectAndCompute(wide, _inner(wide > 0))
        if not points:
            return np.zeros(0), np.zeros((0, 3 + DIMENSIONS))
        uv = np.array([point.pt for point in points]) - [wrap, 0]
        directions = camera.directions(uv) @ R_sphere_belt.T
        own = (np.abs(np.arcsin(np.clip(directions[:, 2], -1, 1))) > WIDEST_RAD) == steep
        own &= (uv[:, 0] >= -0.5) & (uv[:, 0] < picture.shape[1] - 0.5)
        response = np.array([point.response for point in points])
        return response[own], np.hstack([directions, unit(vectors)])[own]


def _inner(seen: Bools) -> Bytes:
    """What is seen less a margin, where the edge of what is not would be a feature."""
    import cv2

    return np.asarray(cv2.erode(seen.astype(np.uint8), np.ones((13, 13), np.uint8), borderValue=1), np.uint8)
