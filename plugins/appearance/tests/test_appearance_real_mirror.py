"""Two published pictures of a mirror that was turned on the spot, through their published calibration."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from omnilab.cameras import UnifiedCamera
from omnilab.image import mirror_view, panorama
from omnilab_appearance import PocBand, Radon

DATA = Path(__file__).resolve().parents[4] / "shared/data/amiens_catadioptric"
CAMERA = UnifiedCamera(
    width=1600, height=1200, cx=692.86729, cy=572.11922, fx=425.19303, fy=424.86463, xi=0.98754, rim_px=495, inner_px=75
)
COLUMNS, SECTORS = 720, 8
TURN_DEG = 46.5  # found by correlating their panoramas; the files' names say 45


@pytest.fixture(scope="module")
def pictures():
    files = [DATA / f"{name}.pgm" for name in ("Im_R0_T0", "Im_R45_T0")]
    if not all(file.exists() for file in files):
        pytest.skip(f"the published pictures are not in {DATA}")
    return np.stack([cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in files])


def rotation_deg(pictures, camera):
    signatures = Radon().describe(mirror_view(pictures, camera))
    match = PocBand().match(signatures[1:], PocBand().prepare(signatures[:1]))
    return np.rad2deg(match.rotation_rad[0, 0])


def test_the_rotation_between_the_pictures(pictures):
    """The camera looks up, so the pictures as taken turn the other way than the robot: flipped, it turned to the left."""
    assert rotation_deg(pictures, CAMERA) == pytest.approx(-TURN_DEG, abs=1.5)
    assert rotation_deg(pictures[:, :, ::-1], CAMERA.flipped()) == pytest.approx(TURN_DEG, abs=1.5)


def heights_deg(pictures, camera):
    """How much higher the second panorama shows the same things than the first, in each sector."""
    first, second = panorama(pictures, camera, (180, COLUMNS)).astype(np.float32)
    first = np.roll(first, round(TURN_DEG * COLUMNS / 360), axis=1)
    width = COLUMNS // SECTORS
    window = cv2.createHanningWindow((width, 180), cv2.CV_32F)
    sectors = zip(np.split(first, SECTORS, 1), np.split(second, SECTORS, 1), strict=True)
    rows = [cv2.phaseCorrelate(np.ascontiguousarray(a), np.ascontiguousarray(b), window)[0][1] for a, b in sectors]
    return np.array(rows) * (60 + np.rad2deg(camera.elevations_rad[1])) / 180  # panoramas end at -60 degrees


def test_the_panoramas_are_level(pictures):
    """What is in one direction stays at its height when the robot turns; a wrong centre makes it go up and down."""
    assert np.abs(heights_deg(pictures, CAMERA)).max() < 1.0
    shifted = replace(CAMERA, cx=CAMERA.cx + 10)
    assert np.abs(heights_deg(pictures, shifted)).max() > 1.8


def test_the_horizon_is_where_the_calibration_puts_it():
    u, v = CAMERA.pixels(np.array([1.0, 0, 0]))
    assert (u - CAMERA.cx, v) == (pytest.approx(425.19303 / 0.98754), pytest.approx(CAMERA.cy))
