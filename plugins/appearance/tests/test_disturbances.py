"""Disturbances against closed forms: moments of noise, covered area, a blurred point, levels by hand, a turned sky."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from omnilab.api import Circle
from omnilab.cameras import CylindricalCamera, EquirectangularCamera, HyperbolicMirror, ImageCircle
from omnilab.errors import ConfigError, DataError, PluginError
from omnilab.testing import check_disturbance
from omnilab_appearance import Blur, ColorShift, GaussianNoise, Light, ListingNoise, Occlusion, Tilt, UniformNoise

MIRROR = HyperbolicMirror(200)


def _apply(disturbance, images, camera=MIRROR, seed=0):
    return disturbance.apply(images, camera, [np.random.default_rng([seed, i]) for i in range(len(images))])


@pytest.mark.parametrize("color", [False, True], ids=["grey", "rgb"])
@pytest.mark.parametrize(
    ("disturbance", "harmless"),
    [
        (UniformNoise(), UniformNoise(0)),
        (UniformNoise(positive=True), UniformNoise(0, positive=True)),
        (GaussianNoise(), GaussianNoise(0)),
        (ListingNoise(), ListingNoise(0)),
        (Occlusion(), Occlusion(0)),
        (Blur(), Blur(0)),
        (Light(0.7, 1.3), Light(1)),
        (Tilt(), Tilt(0)),
        (Tilt(axis_deg=30), Tilt(0, axis_deg=30)),
    ],
    ids=repr,
)
def test_keeps_the_contract(disturbance, harmless, color):
    check_disturbance(disturbance, harmless, color)


def test_color_shift_keeps_the_contract():
    check_disturbance(ColorShift(), ColorShift([1, 1, 1]), color=True)


@dataclass
class Broken:
    """Breaks one promise."""

    promise: str = "none"  # which

    def apply(self, images, camera, rngs):
        if self.promise == "input":
            images[:, 0, 0] ^= 1
        if self.promise == "dtype":
            return images.astype(float)
        if self.promise == "shape":
            return images[:, 1:]
        if self.promise == "batch":
            return np.stack([rngs[0].permutation(image) for image in images])
        if self.promise == "seed":
            return np.random.default_rng().permutation(images, axis=1)
        return images.copy()


def test_the_check_finds_what_is_broken():
    check_disturbance(Broken(), Broken())
    words_of = {
        "input": "writes into its input `images`",
        "dtype": "float64",
        "shape": "images of shape",
        "batch": "one by one",
        "seed": "second",
    }
    for promise, words in words_of.items():
        with pytest.raises((AssertionError, PluginError), match=words):
            check_disturbance(Broken(promise), Broken())
    with pytest.raises(AssertionError, match="changes nothing"):
        check_disturbance(Broken(), Light(0.5))


# ------------------------------------------------------------------------------------------------------------- noise
@pytest.mark.parametrize(
    ("noise", "mean", "variance", "largest"),
    [
        (UniformNoise(0.4), 0, (255 * 0.4) ** 2 / 3, 102),
        (UniformNoise(0.4, positive=True), 51, (255 * 0.4) ** 2 / 12, 102),
        (GaussianNoise(0.08), 0, 20.4**2, 128),
        (ListingNoise(10), -10, 20.0**2, 128),
    ],
    ids=repr,
)
def test_moments_of_noise_that_clips_nothing(noise, mean, variance, largest):
    clear = np.full((4, 250, 250), 128, np.uint8)
    added = _apply(noise, clear).astype(float) - 128
    count = added.size
    assert np.abs(added).max() <= largest
    assert abs(added.mean() - mean) < 5 * np.sqrt(variance / count)
    assert abs(added.var() - variance - 1 / 12) < 5 * variance * np.sqrt(2 / count)  # 1/12: rounding
    row = added - added.mean()
    assert abs((row[..., 1:] * row[..., :-1]).mean()) < 5 * variance / np.sqrt(count)  # neighbours are independent


@pytest.mark.parametrize("noise", [UniformNoise(1.0), GaussianNoise(1.0), ListingNoise(255)], ids=repr)
def test_noise_is_clipped_and_never_wraps(noise):
    dark, bright = _apply(noise, np.stack([np.zeros((99, 99), np.uint8), np.full((99, 99), 255, np.uint8)]))
    assert (dark == 0).mean() > 0.45
    assert (bright == 255).mean() > 0.25


def test_each_image_has_its_own_noise():
    one, other = _apply(UniformNoise(), np.full((2, 40, 40), 128, np.uint8)).astype(int) - 128
    assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 0.1


# --------------------------------------------------------------------------------------------------------- occlusion
@given(
    st.integers(16, 120), st.integers(16, 120), st.integers(1, 6), st.floats(0, 1), st.integers(0, 99), st.booleans()
)
@settings(max_examples=80, deadline=None)
def test_the_covered_area_is_exact_to_a_row_or_column(height, width, rectangles, fraction, seed, color):
    shape = (1, height, width, 3) if color else (1, height, width)
    image = np.random.default_rng(seed).choice(np.array([0, 255], np.uint8), shape)  # its mean is none of its levels
    occluded = _apply(Occlusion(fraction, rectangles), image, seed=seed)
    changed = (occluded != image)[0]
    covered = changed.any(-1) if color else changed
    assert abs(covered.sum() - fraction * height * width) <= max(height, width)
    mean = np.rint(image[0].mean((0, 1)))
    assert np.array_equal(occluded[0][covered], np.broadcast_to(mean, occluded[0][covered].shape))


def test_occlusions_are_rectangles_at_random_places():
    image = np.random.default_rng(0).choice(np.array([0, 255], np.uint8), (30, 100, 100))
    image[...] = image[0]
    covered = _apply(Occlusion(0.1, 1), image) != image
    for mask in covered:
        rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
        assert mask.sum() == len(rows) * len(columns)
        assert mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].all()
    assert len(np.unique(covered.reshape(30, -1), axis=0)) == 30


# ----------------------------------------------------------------------------------------- blur, light, color_shift
@pytest.mark.parametrize("sigma", [1.0, 2.5])
def test_a_point_is_blurred_to_a_gaussian(sigma):
    line = np.zeros((1, 61, 61), np.uint8)
    line[0, :, 30] = 255  # a line, so that the levels are high enough to be distinguished
    away = np.arange(61) - 30
    expected = 255 * np.exp(-(away**2) / (2 * sigma**2)) / (sigma * np.sqrt(2 * np.pi))
    assert np.abs(_apply(Blur(sigma), line)[0] - expected).max() < 0.6


def test_blur_equals_scipy_in_every_channel():
    image = np.random.default_rng(1).integers(0, 256, (2, 50, 70, 3), dtype=np.uint8)
    expected = gaussian_filter(image.astype(float), (0, 2, 2, 0), mode="mirror", truncate=4)
    assert np.abs(_apply(Blur(2), image) - expected).max() < 0.51


def test_light_by_hand():
    levels = np.array([[[0, 64, 128, 255]]], np.uint8)
    assert _apply(Light(0.5), levels).tolist() == [[[0, 32, 64, 128]]]
    assert _apply(Light(2.0), levels).tolist() == [[[0, 128, 255, 255]]]
    assert _apply(Light(1.0, 2.0), levels).tolist() == [[[0, 16, 64, 255]]]  # 64^2 / 255, 128^2 / 255
    assert _apply(Light(1.0, 0.5), levels).tolist() == [[[0, 128, 181, 255]]]  # sqrt(255 * 64), sqrt(255 * 128)


def test_colors_by_hand_and_none_on_grey():
    pixel = np.array([[[[100, 100, 100], [250, 7, 0]]]], np.uint8)
    assert _apply(ColorShift([1.5, 1.0, 0.25]), pixel).tolist() == [[[[150, 100, 25], [255, 7, 0]]]]
    with pytest.raises(DataError, match=r"sensor\.color=true"):
        _apply(ColorShift(), pixel[..., 0])


# -------------------------------------------------------------------------------------------------------------- tilt
def _sky(direction):
    """A smooth world at infinity: grey level of directions (..., 3)."""
    return 128 + direction @ np.array([60.0, -45.0, 30.0])


def _looks(camera):
    v, u = np.mgrid[: camera.height, : camera.width]
    return camera.directions(np.stack([u, v], -1).astype(float))


@given(st.floats(-40, 40), st.floats(-180, 180))
@settings(max_examples=25, deadline=None)
def test_a_tilted_image_is_that_of_the_turned_camera(angle_deg, axis_deg):
    upright = np.rint(_sky(_looks(MIRROR))).astype(np.uint8)
    tilted = _apply(Tilt(angle_deg, axis_deg), upright[None])[0]
    # the camera's axes in the upright frame: first the axis to +x, then the lean, then back
    a, t = np.deg2rad(axis_deg), np.deg2rad(angle_deg)
    Rz = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    Rx = np.array([[1, 0, 0], [0, np.cos(t), -np.sin(t)], [0, np.sin(t), np.cos(t)]])
    turned = _looks(MIRROR) @ (Rz @ Rx @ Rz.T).T
    source = MIRROR.pixels(turned)
    seen = ((source >= 0) & (source <= 199)).all(-1)
    assert np.abs(tilted[seen] - _sky(turned)[seen]).max() < 2
    gone = ~((source > -1) & (source < 200)).all(-1)
    assert not tilted[gone].any()


@pytest.mark.parametrize("disturbance", [Tilt(17, 40), Blur(3)], ids=["tilt", "blur"])
@pytest.mark.parametrize("model", [EquirectangularCamera, CylindricalCamera])
def test_panoramas_have_no_seam(disturbance, model):
    """Rotated by whole columns, what is tilted or blurred is the same picture, wherever its ends were."""
    picture = np.random.default_rng(5).integers(1, 256, (1, 60, 120), np.uint8)
    (found,) = _apply(disturbance, picture, model(120, 60, 0.0))
    (elsewhere,) = _apply(disturbance, np.roll(picture, -50, axis=2), model(120, 60, 50 * 360 / 120))
    assert np.abs(np.roll(elsewhere, 50, axis=1).astype(int) - found).max() <= 1


def test_a_tilted_sphere_shows_all_of_the_sky():
    camera = EquirectangularCamera(240, 120, 180.0, True)
    upright = np.rint(_sky(_looks(camera))).astype(np.uint8)
    tilted = _apply(Tilt(90, 0), upright[None], camera)[0]
    R_upright_leaning = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    assert np.abs(tilted - _sky(_looks(camera) @ R_upright_leaning.T)).max() < 2


def test_a_quarter_turn_shows_at_the_centre_what_was_at_the_side():
    """The centre looks straight down; leaning by +90 degrees about +x, it looks where +y was: towards image up."""
    camera = HyperbolicMirror(201, crop=1.0)
    upright = np.zeros((1, 201, 201), np.uint8)
    u, v = np.rint(camera.pixels(np.array([0.0, 1.0, 0.0]))).astype(int)
    upright[0, v - 3 : v + 4, u - 3 : u + 4] = 200
    assert v < 100 == u
    assert _apply(Tilt(90, 0), upright, camera)[0, 100, 100] == 200
    assert _apply(Tilt(-90, 0), upright, camera)[0, 100, 100] == 0


def test_drawn_axes_differ():
    upright = np.rint(_sky(_looks(MIRROR))).astype(np.uint8)
    one, other = _apply(Tilt(10), np.stack([upright, upright]))
    assert np.abs(one.astype(int) - other).max() > 5


def test_a_camera_that_knows_no_directions_cannot_be_tilted():
    with pytest.raises(DataError, match="which ImageCircle does not; leave"):
        _apply(Tilt(), np.zeros((1, 20, 20), np.uint8), ImageCircle(20, 20, Circle(10, 10, 9)))


# ------------------------------------------------------------------------------------------------------------ limits
@pytest.mark.parametrize(
    ("kind", "settings"),
    [
        (UniformNoise, {"level": 20}),
        (UniformNoise, {"level": float("nan")}),
        (GaussianNoise, {"sigma": -0.1}),
        (ListingNoise, {"level": -1}),
        (Occlusion, {"fraction": 10}),
        (Occlusion, {"rectangles": 0}),
        (Blur, {"sigma_px": -1}),
        (Light, {"gain": -1}),
        (Light, {"gamma": 0}),
        (ColorShift, {"gains": [1.0, 1.0]}),
        (ColorShift, {"gains": [1.0, -1.0, 1.0]}),
        (Tilt, {"angle_deg": 200}),
        (Tilt, {"axis_deg": float("inf")}),
    ],
    ids=lambda value: getattr(value, "__name__", None) or str(value),
)
def test_settings_that_make_no_sense_are_refused(kind, settings):
    with pytest.raises(ConfigError, match=f"{next(iter(settings))}="):
        kind(**settings)


@pytest.mark.parametrize("disturbance", [UniformNoise(), Occlusion(), Blur(), Light(), Tilt()], ids=repr)
def test_no_images_give_no_images(disturbance):
    assert _apply(disturbance, np.zeros((0, 200, 200), np.uint8)).shape == (0, 200, 200)


def test_no_noise_may_be_written_with_a_sign():
    images = np.full((1, 4, 4), 9, np.uint8)
    for noise in (GaussianNoise(-0.0), UniformNoise(-0.0)):
        assert np.array_equal(noise.apply(images, MIRROR, [np.random.default_rng(0)]), images)
