"""What an image shows as points on the unit sphere: features of its panorama, and their matches."""

from __future__ import annotations

from enum import Enum
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from omnilab.api import Bools, Bytes, CalibratedCamera, Camera, Floats, Frames, Ints, Unusable
from omnilab.errors import DataError
from omnilab.image import PANORAMA_SHAPE, panorama, to_gray

SEAM = 16  # columns repeated on either side, so that features on the seam are found
DARK = 8  # grey levels: an image in which nothing is brighter is black
FLAT = 2.0  # grey levels: an image that varies less is flat
FAINT = {"sift": 0.02, "surf": 0.02}  # thresholds below which nothing is a feature
BORDER = 6  # pixels around what the camera does not show, where the edge of the black would be a feature


class Detector(Enum):
    """Which local features."""

    surf = "surf"
    sift = "sift"


class Sighting(NamedTuple):
    """F features of an image, strongest first, and where the camera sees them."""

    directions: Floats | None  # (F, 3) unit float32, in the camera's frame; None of an uncalibrated camera
    azimuth_level: Floats  # (F, 2) float32, on the panorama: azimuth in radians, level of `Camera.unwrap`
    vectors: npt.NDArray[Any]  # (F, D): uint8 of SIFT, float16 of SURF; of any length
    radon: Floats | None = None  # (offsets, angles) of the mirror image, where lengths are told by it


def sightings(frames: Frames, detector: Detector, features: int, least: int) -> list[Sighting | Unusable]:
    """What each image shows; an Unusable where there is nothing to make out, or fewer than `least` features."""
    camera = frames.camera
    shown = _shown(camera)  # type: ignore[arg-type]  # cameras are frozen dataclasses
    return [
        _seen(picture, camera, shown, detector, features, least) for picture in panorama(to_gray(frames.images), camera)
    ]


def _seen(
    picture: Bytes, camera: Camera, shown: Bools, detector: Detector, features: int, least: int
) -> Sighting | Unusable:
    values = picture[shown]
    if values.size == 0 or values.max() <= DARK:
        return Unusable("black")
    if values.std() < FLAT:
        return Unusable("flat: one grey level")
    wide = np.concatenate([picture[:, -SEAM:], picture, picture[:, :SEAM]], axis=1)
    mask = np.concatenate([shown[:, -SEAM:], shown, shown[:, :SEAM]], axis=1)
    uv, vectors = (_sift if detector is Detector.sift else _surf)(wide, mask, features)
    azimuth_level = _on_panorama(uv)
    directions = _on_sphere(azimuth_level, camera)
    whole = (uv[:, 0] >= -0.5) & (uv[:, 0] < picture.shape[1] - 0.5) & np.isfinite(directions).all(axis=1)
    kept = np.flatnonzero(whole)[:features]
    if len(kept) < least:
        return Unusable(f"{len(kept)} features")
    seen = directions[kept].astype(np.float32) if isinstance(camera, CalibratedCamera) else None
    return Sighting(seen, azimuth_level[kept].astype(np.float32), vectors[kept])


def _on_panorama(uv: Floats) -> Floats:
    """Azimuths and levels (F, 2) of pixels (F, 2) of the panorama."""
    rows, columns = PANORAMA_SHAPE
    return np.stack([np.mod(2 * np.pi * uv[:, 0] / columns, 2 * np.pi), 1 - (uv[:, 1] + 0.5) / rows], -1)


def _on_sphere(azimuth_level: Floats, camera: Camera) -> Floats:
    """Unit directions (F, 3); zeros of a camera that does not know them."""
    if not isinstance(camera, CalibratedCamera):
        return np.zeros((len(azimuth_level), 3))
    return camera.directions(camera.unwrap(azimuth_level[:, 0], azimuth_level[:, 1]))


@lru_cache(maxsize=8)
def _shown(camera: Camera) -> Bools:
    """Which pixels of the panorama lie well within what the camera shows."""
    import cv2

    rows, columns = PANORAMA_SHAPE
    v, u = np.mgrid[:rows, -SEAM : columns + SEAM].astype(float)
    azimuth, level = 2 * np.pi * u / columns, 1 - (v + 0.5) / rows
    pixels = camera.unwrap(azimuth, level)
    with np.errstate(invalid="ignore"):
        inside = ((pixels > -0.5) & (pixels < [camera.width - 0.5, camera.height - 0.5])).all(axis=-1)
    eroded = cv2.erode(inside.astype(np.uint8), np.ones((2 * BORDER + 1, 2 * BORDER + 1), np.uint8))
    return np.asarray(eroded[:, SEAM:-SEAM] > 0)


def _sift(picture: Bytes, mask: Bools, features: int) -> tuple[Floats, npt.NDArray[Any]]:
    """Pixels (F, 2) of the panorama without its seam, and SIFT vectors (F, 128) uint8."""
    import cv2

    wanted = int(1.25 * features)  # some are found twice, on either side of the seam
    finder = cv2.SIFT_create(  # type: ignore[attr-defined]
        nfeatures=wanted, contrastThreshold=FAINT["sift"], enable_precise_upscale=True
    )
    points, vectors = finder.detectAndCompute(picture, mask.astype(np.uint8))
    if not points:
        return np.zeros((0, 2)), np.zeros((0, 128), np.uint8)
    uv = np.array([point.pt for point in points])
    order = np.argsort([-point.response for point in points], kind="stable")
    _, first = np.unique(uv[order], axis=0, return_index=True)  # a point of two orientations is no second witness
    order = order[np.sort(first)]
    return uv[order] - [SEAM, 0], vectors[order].astype(np.uint8)


def _surf(picture: Bytes, mask: Bools, features: int) -> tuple[Floats, npt.NDArray[Any]]:
    """Pixels (F, 2) of the panorama without its seam, and SURF vectors (F, 64) float16."""
    from mahotas.features import surf

    found = surf.surf(picture, threshold=FAINT["surf"], max_points=int(1.25 * features))
    found = found[np.argsort(-found[:, 3], kind="stable")]  # y, x, scale, score, laplacian, angle, vector
    v, u = np.rint(found[:, :2]).astype(int).T
    found = found[mask[np.clip(v, 0, len(mask) - 1), np.clip(u, 0, mask.shape[1] - 1)]]
    return found[:, 1::-1] - [SEAM, 0], found[:, 6:].astype(np.float16)


def check_calibrated(camera: Camera, instead: str) -> None:
    """DataError for a camera that does not know where its pixels look; it names what does without."""
    if not isinstance(camera, CalibratedCamera):
        raise DataError(
            f"a {type(camera).__name__} does not know where its pixels look, and planar geometry needs that; give the images"
            f" a calibration, or choose {instead}"
        )


def on_sphere(sighting: Sighting) -> Floats:
    """Unit directions (F, 3); DataError of an uncalibrated camera."""
    if sighting.directions is None:
        raise DataError("an uncalibrated camera does not know where its pixels look; give the images a calibration")
    return sighting.directions


def matched(before: Sighting, now: Sighting, ratio: float) -> tuple[Ints, Ints]:
    """Pairs of features (M,), (M,): each the other's best, and nearer than `ratio` of the second best."""
    import cv2

    a, b = unit(before.vectors), unit(now.vectors)
    if len(a) < 2 or len(b) < 2:
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    alike = cv2.gemm(
        a, b, 1.0, None, 0.0, flags=cv2.GEMM_2_T
    )  # numpy's threads cost 50 times as much on a busy machine
    rows = np.arange(len(a))
    partner = alike.argmax(axis=1)
    best = alike[rows, partner].copy()
    mutual = alike.argmax(axis=0)[partner] == rows
    alike[rows, partner] = -2
    clear = 1 - best < ratio**2 * (1 - alike.max(axis=1))
    chosen = np.flatnonzero(mutual & clear)
    return chosen, partner[chosen]


def unit(vectors: npt.NDArray[Any]) -> Floats:
    """Vectors (F, D) float32 of length 1."""
    values = vectors.astype(np.float32)
    return np.asarray(values / np.maximum(np.linalg.norm(values, axis=1, keepdims=True), 1e-12))
