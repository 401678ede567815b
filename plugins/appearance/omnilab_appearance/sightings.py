"""Local features of a panorama, placed back on the unit sphere around the camera that took the picture."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np

from omnilab.api import Bytes, CalibratedCamera, Camera, Floats, Frames, Ints, Unusable
from omnilab.errors import ConfigError
from omnilab.projection import PANORAMA_SHAPE, panorama, to_gray

SEAM = 32  # columns that are seen twice, so that features across the seam are found
FLAT = 2.0  # grey levels: a picture that varies less shows nothing


class Detector(Enum):
    """Which local features."""

    sift = "sift"
    surf = "surf"


class Sighting(NamedTuple):
    """F local features of one picture, the strongest first."""

    azimuth_level: Floats  # (F, 2) float32, of `Camera.unwrap`
    vectors: Floats | Bytes  # (F, D)
    directions: Floats | None  # (F, 3) in the camera's frame; None of a camera that does not know them

    def __len__(self) -> int:
        return len(self.azimuth_level)


@dataclass
class Features:
    """Finds local features in panoramas of 128 x 512 pixels."""

    detector: Detector = Detector.sift  # or surf, as printed
    count: int = 500  # at most, of each picture
    contrast: float = 0.02  # what is fainter is no feature (of surf: 0.1 of its own measure is usual)

    def __post_init__(self) -> None:
        if self.count < 8 or not self.contrast > 0:
            raise ConfigError(
                f"{self.count} features of contrast {self.contrast:g} are not enough for a motion; give 8 or more, above 0"
            )

    def sightings(self, frames: Frames) -> list[Sighting | Unusable]:
        """What is seen in each picture of a batch."""
        pictures = panorama(to_gray(frames.images), frames.camera)
        return [self._sighting(picture, frames.camera) for picture in pictures]

    def _sighting(self, picture: Bytes, camera: Camera) -> Sighting | Unusable:
        if picture.std() < FLAT:
            return Unusable("black" if picture.max() < 3 * FLAT else "the picture is of one grey")
        uv, vectors = self._found(np.hstack([picture[:, -SEAM:], picture, picture[:, :SEAM]]))
        rows, columns = PANORAMA_SHAPE
        u = uv[:, 0] - SEAM
        once = (u >= -0.5) & (u < columns - 0.5)
        azimuth_level = np.column_stack([2 * np.pi * u / columns, 1 - (uv[:, 1] + 0.5) / rows])[once].astype(np.float32)
        directions = None
        if isinstance(camera, CalibratedCamera):
            where = azimuth_level.astype(float)
            directions = camera.directions(camera.unwrap(where[:, 0], where[:, 1])).astype(np.float32)
            seen = np.isfinite(directions).all(axis=1)
            azimuth_level, vectors, directions = azimuth_level[seen], vectors[once][seen], directions[seen]
        else:
            vectors = vectors[once]
        if len(azimuth_level) < 8:
            return Unusable(f"{len(azimuth_level)} features are found")
        return Sighting(azimuth_level, vectors, directions)

    def _found(self, picture: Bytes) -> tuple[Floats, Floats | Bytes]:
        """Pixels (F, 2) and vectors (F, D), the strongest first."""
        if self.detector is Detector.surf:
            from mahotas.features import surf

            found = surf.surf(picture, threshold=self.contrast, max_points=self.count)
            found = found[np.argsort(-found[:, 3], kind="stable")]  # y, x, scale, score, laplacian, angle, vector
            return found[:, 1::-1], found[:, 6:].astype(np.float32)
        import cv2

        detector = cv2.SIFT_create(nfeatures=self.count, contrastThreshold=self.contrast)  # type: ignore[attr-defined]
        points, vectors = detector.detectAndCompute(picture, None)
        if not points:
            return np.zeros((0, 2)), np.zeros((0, 128), np.uint8)
        order = np.argsort([-point.response for point in points], kind="stable")[: self.count]
        return np.array(cv2.KeyPoint.convert(points))[order], vectors[order].astype(np.uint8)  # whole numbers up to 255


def matches(before: Sighting, now: Sighting, ratio: float) -> tuple[Ints, Ints]:
    """Features (M,) of two pictures that are each other's best match and pass Lowe's ratio test both ways."""
    one, other = (_unit(sighting.vectors) for sighting in (before, now))
    alike = one @ other.T
    partner, back = alike.argmax(axis=1), alike.argmax(axis=0)
    here = np.arange(len(one))
    mutual = back[partner] == here
    best = alike[here, partner]
    alike[here, partner] = -1
    second = np.maximum(alike.max(axis=1), alike.max(axis=0)[partner])
    good = mutual & (1 - best < ratio**2 * (1 - second))
    return here[good], partner[good]


def _unit(vectors: Floats | Bytes) -> Floats:
    vectors = vectors.astype(np.float32)
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12))
