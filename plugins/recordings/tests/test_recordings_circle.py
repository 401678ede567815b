"""The image circle is found where a synthetic mirror image has it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnilab.errors import DataError
from omnilab_recordings.images.circle import find_circle

SHAPE = (180, 240)


def mirror_images(cx, cy, radius, inner, seed=0, noise=0.0, surround=4, count=3, shape=SHAPE):
    """Textured rings in a dark surround, with additive Gaussian noise."""
    rng = np.random.default_rng(seed)
    v, u = np.indices(shape)
    distance = np.hypot(u - cx, v - cy)
    ring = (distance <= radius) & (distance >= inner)
    world = [cv2.GaussianBlur(rng.uniform(-600, 600, shape), (0, 0), 4) + 130 for _ in range(count)]
    seen = np.where(ring, np.clip(world, 60, 250), surround) + rng.normal(0, noise, (count, *shape))
    return np.clip(seen, 0, 255).astype(np.uint8)


@settings(deadline=None, max_examples=40)
@given(
    cx=st.floats(95, 145), cy=st.floats(80, 100), radius=st.floats(40, 78), inner=st.sampled_from([0.0, 9.0, 15.0]),
    noise=st.floats(0, 10), surround=st.integers(0, 25), seed=st.integers(0, 1000),
)  # fmt: skip
def test_a_ring_in_a_dark_surround(cx, cy, radius, inner, noise, surround, seed):
    found = find_circle(mirror_images(cx, cy, radius, inner, seed, noise, surround))
    assert (found.cx, found.cy) == pytest.approx((cx, cy), abs=0.5)
    assert found.radius == pytest.approx(radius, abs=0.5)
    assert found.inner == pytest.approx(inner, abs=1.5)


def test_dark_objects_at_the_rim_and_one_image():
    (image,) = mirror_images(118, 90, 75, 0, count=1)
    for azimuth in (0.3, 2.0, 4.4):
        at = (round(118 + 75 * np.cos(azimuth)), round(90 + 75 * np.sin(azimuth)))
        cv2.circle(image, at, 22, 2, -1)
    found = find_circle(image[None])
    assert (found.cx, found.cy, found.radius) == pytest.approx((118, 90, 75), abs=1.5)


def test_things_that_shine_in_the_surround():
    images = mirror_images(118, 90, 70, 0)
    for image in images:
        cv2.putText(image, "12:30", (2, 14), cv2.FONT_HERSHEY_PLAIN, 1, 255)  # burnt in, apart from the ring
        cv2.rectangle(image, (180, 85), (205, 95), 255, -1)  # a reflection that grows out of the rim
    found = find_circle(images)
    assert (found.cx, found.cy, found.radius) == pytest.approx((118, 90, 70), abs=1.5)


def test_a_circle_cut_by_the_frame():
    found = find_circle(mirror_images(118, 90, 105, 12))
    assert (found.cx, found.cy, found.radius) == pytest.approx((118, 90, 105), abs=1.5)


def test_a_filled_frame_has_its_inscribed_circle():
    found = find_circle(mirror_images(120, 90, 400, 0))
    assert (found.cx, found.cy, found.radius, found.inner) == (119.5, 89.5, 90.0, 0.0)


def test_a_lit_rectangle_is_no_circle():
    image = np.zeros(SHAPE, np.uint8)
    image[40:140, 30:200] = 180
    with pytest.raises(DataError, match=r"no image circle .*sensor\.circle_px="):
        find_circle(image[None])
