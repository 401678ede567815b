"""The size of a camera's panoramas, against what the camera's projection says in closed form."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnilab.api import Circle
from omnilab.cameras import (
    EIZOH_WIDE_70,
    THESIS_HALF,
    EquirectangularCamera,
    ImageCircle,
    ParabolicMirror,
    PinholeCamera,
)
from omnilab.errors import ConfigError
from omnilab.image import PANORAMA_SHAPE, panorama, panorama_shape

ROWS, COLUMNS = PANORAMA_SHAPE


@given(st.integers(600, 9000), st.integers(300, 5000), st.floats(-180, 180), st.booleans())
def test_a_sphere_keeps_its_own_pixels(width, height, start_deg, clockwise):
    """Of its 180 degrees of elevation a panorama shows 120."""
    camera = EquirectangularCamera(width, height, start_deg, clockwise)
    rows, columns = panorama_shape(camera)
    assert columns == width
    assert abs(rows - max(ROWS, height * 2 / 3)) <= 0.5 + 1e-3


@given(st.integers(500, 3000), st.floats(5, 60), st.floats(5, 60))
def test_a_parabolic_mirror_has_the_radius_of_its_middle_elevation(size, h_mm, rim_mm):
    """r = r0 tan(pi/4 + e/2) and dr/de = r0 / 2 / cos(pi/4 + e/2)^2 grow with e: their medians are those of the middle."""
    camera = ParabolicMirror(size, h_mm=h_mm, rim_mm=rim_mm)
    low, high = -np.pi / 3, min(camera.highest_rad, np.pi / 3)
    if high <= low + 0.1:
        return
    half = np.pi / 4 + (low + high) / 4
    radius, slope = camera.horizon_px * np.tan(half), camera.horizon_px / 2 / np.cos(half) ** 2
    rows, columns = panorama_shape(camera)
    assert (
        abs(rows - max(ROWS, slope * (high - low))) <= 0.5 + 0.02 * rows
    )  # by 64 levels, half of them below the middle
    assert abs(columns - max(COLUMNS, 2 * np.pi * radius)) <= 0.5 + 0.03 * columns


def test_a_circle_has_its_radius_as_rows():
    camera = ImageCircle(1280, 960, Circle(640, 480, 470, 70))
    assert panorama_shape(camera) == (400, round(2 * np.pi * (470 + 70) / 2))


def test_small_mirrors_keep_the_size_of_the_papers():
    assert panorama_shape(THESIS_HALF) == PANORAMA_SHAPE
    assert panorama_shape(EIZOH_WIDE_70) == (268, 802)


def test_a_camera_that_looks_ahead_counts_only_where_it_looks():
    """Along its axis a pixel is 1 / focal_px radians wide, and wider towards the edges."""
    camera = PinholeCamera(width=640, height=480, cx=319.5, cy=239.5, looks="ahead", focal_px=500.0)
    rows, columns = panorama_shape(camera)
    low, high = camera.elevations_rad
    assert 2 * np.pi * 500 * 0.9 < columns < 2 * np.pi * 500 * 1.2
    assert (high - low) * 500 < rows < (high - low) * 500 * 1.3


def test_panoramas_that_no_memory_holds_are_refused(monkeypatch):
    images = np.zeros((1, 250, 250), np.uint8)
    with pytest.raises(ConfigError, match="a panorama of 2 x 32765 pixels is too large; give at most 32764 a side"):
        panorama(images, THESIS_HALF, (2, 32_765))
    monkeypatch.setattr("omnilab.limits.free_memory", lambda: 1e8)
    with pytest.raises(ConfigError, match=r"the 3000 x 12000 pixels of a panorama take at least 2\.3 GB of memory"):
        panorama(images, THESIS_HALF, (3000, 12_000))
