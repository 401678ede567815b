"""Local features of a panorama as directions on the unit sphere, and their matching."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import Any

import numpy as np
import numpy.typing as npt

from omnilab.api import Bools, Bytes, CalibratedCamera, Camera, Floats, Frames, ImageFeatures, Ints, Unusable
from omnilab.errors import DataError
from omnilab.image import PANORAMA_SHAPE, panorama, panorama_shape, to_gray
from omnilab.limits import check_work
from omnilab_appearance.common.local_features import Detector
from omnilab_appearance.common.vectors import unit

SEAM = 1 / 32  # of the columns are repeated on either side, so that features on the seam are found
DARK = 8  # grey levels: an image in which nothing is brighter is black
FLAT = 2.0  # grey levels: an image that varies less is flat
CONTRAST = {"sift": 0.02, "surf": 0.02, "fast_sift": 0.013}  # detection thresholds
COMPILED = {Detector.fast_sift, Detector.plain_sift}
COLUMNS_PER_ROW = PANORAMA_SHAPE[1] // PANORAMA_SHAPE[0]  # where the rows are given
MOST_ROWS = 8191  # OpenCV takes no more columns than are four times that
# of a panorama's pixel, in octaves that halve: OpenCV's SIFT blurs the doubled picture 6 times in float32 and subtracts 5 times,
# the compiled one blurs as often and marks extrema of three layers
DETECTION_BYTES = {
    Detector.surf: 16.0,
    Detector.sift: 4 * (4 * 11) * 4 / 3,
    Detector.fast_sift: 4 * (4 * 6 + 3) * 4 / 3,
    Detector.plain_sift: (4 * 6 + 3) * 4 / 3,
}
Detect = Callable[[Bytes, Bools, int], tuple[Floats, npt.NDArray[Any]]]
EXACT = 2**24 // 255**2  # bytes of a vector whose products float32 adds without rounding
BORDER = 6  # pixels around what the camera does not show, where the edge of the black would be a feature


def spherical_features(
    frames: Frames, detector: Detector, count: int, least: int, rows: int | None = None, upright: bool = False
) -> list[ImageFeatures | Unusable]:
    """The strongest `count` features of each image; an Unusable for a black or flat one, or one with fewer than `least`.

    They are found on panoramas of the camera's own resolution, or of so many rows and four times as many columns.
    `upright` ones, of SIFT, have the panorama's own axes: how a robot turns about a vertical axis moves a panorama sideways and rotates nothing in it, and an
    orientation that is not estimated cannot differ between two images (Bay et al., 2006, of U-SURF).
    """
    camera = frames.camera
    shape = panorama_shape(camera) if rows is None else (rows, COLUMNS_PER_ROW * rows)  # type: ignore[arg-type]  # cameras are frozen dataclasses
    valid = _valid_pixels(camera, shape, detector)  # type: ignore[arg-type]
    panoramas = panorama(to_gray(frames.images), camera, shape)
    detect = detector_of(detector, upright)
    return [_detect(image, camera, valid, detect, count, least) for image in panoramas]


def detector_of(detector: Detector, upright: bool = False) -> Detect:
    """What finds a few more than the strongest `count` features of a picture (H, W) within a mask: pixels and vectors."""
    if detector is Detector.surf:
        return _surf
    if detector in COMPILED:
        return partial(_compiled_sift, upright=upright, doubled=detector is Detector.fast_sift)
    return _upright_sift if upright else _sift


def _detect(
    image: Bytes, camera: Camera, valid: Bools, detect: Detect, count: int, least: int
) -> ImageFeatures | Unusable:
    if reason := unusable(image[valid]):
        return Unusable(reason)
    seam = round(SEAM * image.shape[1])
    wide = np.concatenate([image[:, -seam:], image, image[:, :seam]], axis=1)
    mask = np.concatenate([valid[:, -seam:], valid, valid[:, :seam]], axis=1)
    uv, vectors = detect(wide, mask, count)
    uv = uv - [seam, 0]
    azimuth_level = _azimuth_level(uv, image.shape)
    directions = _directions(azimuth_level, camera)
    whole = (uv[:, 0] >= -0.5) & (uv[:, 0] < image.shape[1] - 0.5) & np.isfinite(directions).all(axis=1)
    kept = np.flatnonzero(whole)[:count]
    if len(kept) < least:
        return Unusable(f"{len(kept)} features")
    calibrated = directions[kept].astype(np.float32) if isinstance(camera, CalibratedCamera) else None
    return ImageFeatures(calibrated, azimuth_level[kept].astype(np.float32), vectors[kept])


def unusable(values: Bytes) -> str:
    """Why no feature can be made out among grey levels (K,); "" if that may be."""
    if values.size == 0 or values.max() <= DARK:
        return "black"
    return "flat: one grey level" if values.std() < FLAT else ""


def _azimuth_level(uv: Floats, shape: tuple[int, ...]) -> Floats:
    """Azimuths and levels (F, 2) of pixels (F, 2) of a panorama of a shape."""
    rows, columns = shape
    return np.stack([np.mod(2 * np.pi * uv[:, 0] / columns, 2 * np.pi), 1 - (uv[:, 1] + 0.5) / rows], -1)


def _directions(azimuth_level: Floats, camera: Camera) -> Floats:
    """Unit directions (F, 3); zeros of an uncalibrated camera."""
    if not isinstance(camera, CalibratedCamera):
        return np.zeros((len(azimuth_level), 3))
    return camera.directions(camera.unwrap(azimuth_level[:, 0], azimuth_level[:, 1]))


@lru_cache(maxsize=8)
def _valid_pixels(camera: Camera, shape: tuple[int, int], detector: Detector) -> Bools:
    """Mask (H, W) of the panorama's pixels within the camera's frame, eroded by BORDER pixels.

    ConfigError if the machine has no memory to find features on such a panorama.
    """
    import cv2

    rows, columns = shape
    check_work(
        f"the features of a panorama of {rows} x {columns} pixels",
        "give fewer panorama_rows",
        memory=DETECTION_BYTES[detector] * rows * columns,
    )
    v, u = np.mgrid[:rows, -BORDER : columns + BORDER].astype(float)
    azimuth, level = 2 * np.pi * u / columns, 1 - (v + 0.5) / rows
    pixels = camera.unwrap(azimuth, level)
    with np.errstate(invalid="ignore"):
        inside = ((pixels > -0.5) & (pixels < [camera.width - 0.5, camera.height - 0.5])).all(axis=-1)
    eroded = cv2.erode(inside.astype(np.uint8), np.ones((2 * BORDER + 1, 2 * BORDER + 1), np.uint8))
    return np.asarray(eroded[:, BORDER:-BORDER] > 0)


def _sift(image: Bytes, mask: Bools, count: int) -> tuple[Floats, npt.NDArray[Any]]:
    """Pixels (F, 2) of a picture, and SIFT vectors (F, 128) uint8."""
    points, vectors = _sift_detector(count).detectAndCompute(image, mask.astype(np.uint8))
    return _strongest(points, vectors)


def _upright_sift(image: Bytes, mask: Bools, count: int) -> tuple[Floats, npt.NDArray[Any]]:
    """As `_sift`, described along the panorama's axes."""
    sift = _sift_detector(count)
    points = sift.detect(image, mask.astype(np.uint8))
    for point in points:
        point.angle = 0.0
    return _strongest(*sift.compute(image, points))


def _compiled_sift(
    image: Bytes, mask: Bools, count: int, upright: bool, doubled: bool
) -> tuple[Floats, npt.NDArray[Any]]:
    """As `_sift` and `_upright_sift`."""
    from omnilab_appearance.common.sift import sift

    return sift(image, mask, int(1.1 * count), CONTRAST["fast_sift"], upright, doubled)


def _sift_detector(count: int) -> Any:
    import cv2

    wanted = int(1.25 * count)  # some are found twice, on either side of the panorama's seam
    return cv2.SIFT_create(  # type: ignore[attr-defined]
        nfeatures=wanted, contrastThreshold=CONTRAST["sift"], enable_precise_upscale=True
    )


def _strongest(points: Sequence[Any], vectors: npt.NDArray[Any] | None) -> tuple[Floats, npt.NDArray[Any]]:
    """OpenCV's keypoints and their vectors (F, 128), strongest first: pixels (F, 2), and uint8."""
    if not points or vectors is None:
        return np.zeros((0, 2)), np.zeros((0, 128), np.uint8)
    uv = np.array([point.pt for point in points])
    order = np.argsort([-point.response for point in points], kind="stable")
    _, first = np.unique(uv[order], axis=0, return_index=True)  # a keypoint of two orientations counts once
    order = order[np.sort(first)]
    return uv[order], vectors[order].astype(np.uint8)


def _surf(image: Bytes, mask: Bools, count: int) -> tuple[Floats, npt.NDArray[Any]]:
    """Pixels (F, 2) of a picture, and SURF vectors (F, 64) float16."""
    from mahotas.features import surf

    found = surf.surf(image, threshold=CONTRAST["surf"], max_points=int(1.25 * count))
    found = found[np.argsort(-found[:, 3], kind="stable")]  # y, x, scale, score, laplacian, angle, vector
    v, u = np.rint(found[:, :2]).astype(int).T
    found = found[mask[np.clip(v, 0, len(mask) - 1), np.clip(u, 0, mask.shape[1] - 1)]]
    return found[:, 1::-1], found[:, 6:].astype(np.float16)


def check_calibrated(camera: Camera, instead: str) -> None:
    """DataError for an uncalibrated camera; `instead` is the component to choose for one."""
    if not isinstance(camera, CalibratedCamera):
        raise DataError(
            f"a {type(camera).__name__} does not know where its pixels look, and planar geometry needs that; give the images"
            f" a calibration, or choose {instead}"
        )


def directions_of(features: ImageFeatures) -> Floats:
    """Unit directions (F, 3) of features; DataError for an uncalibrated camera."""
    if features.directions is None:
        raise DataError("an uncalibrated camera does not know where its pixels look; give the images a calibration")
    return features.directions


def match_features(before: ImageFeatures, now: ImageFeatures, ratio: float) -> tuple[Ints, Ints]:
    """Indices (M,), (M,) of matched features: mutual nearest neighbours that pass Lowe's ratio test."""
    a, b = before.vectors, now.vectors
    if len(a) < 2 or len(b) < 2:
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    cosine = _cosines(a, b)
    rows = np.arange(len(a))
    partner = cosine.argmax(axis=1)
    best = cosine[rows, partner].copy()
    mutual = cosine.argmax(axis=0)[partner] == rows
    cosine[rows, partner] = -2
    clear = 1 - best < ratio**2 * (1 - cosine.max(axis=1))
    chosen = np.flatnonzero(mutual & clear)
    return chosen, partner[chosen]


def _cosines(a: npt.NDArray[Any], b: npt.NDArray[Any]) -> Floats:
    """Cosines (A, B) float32 of vectors (A, D) and (B, D).

    Products of bytes are whole numbers that float32 holds exactly, the same in whatever order and by however many threads
    they are added: of those numpy's product takes a fifth of OpenCV's time. Of others OpenCV's, for numpy's threads cost
    50 times as much on a busy machine.
    """
    import cv2

    a32, b32 = a.astype(np.float32), b.astype(np.float32)
    if a.dtype == b.dtype == np.uint8 and a.shape[1] <= EXACT:
        cosine = a32 @ b32.T
        for vectors, axis in ((a32, 1), (b32, 0)):
            cosine /= np.expand_dims(np.maximum(np.linalg.norm(vectors, axis=1), 1), axis)
        return np.asarray(cosine)
    return np.asarray(cv2.gemm(unit(a32), unit(b32), 1.0, None, 0.0, flags=cv2.GEMM_2_T))
