"""Odometry that is the truth with noise: its covariance is that of its noise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from omnilab.api import Circle, Frames
from omnilab.cameras import ImageCircle
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import planar_poses
from omnilab.testing import check_odometry
from omnilab_appearance import Simulated

CAMERA = ImageCircle(16, 16, Circle(7.5, 7.5, 8))
T = planar_poses([[1.0, 2, 1], [1, 3, 1], [1, 3, 1], [0, 3, 1]], np.deg2rad([90, 90, -170, 170]))
TRUE = np.array(
    [[1.0, 0, 0], [0, 0, np.deg2rad(100)], [np.cos(np.deg2rad(10)), -np.sin(np.deg2rad(10)), -np.deg2rad(20)]]
)


def frames(poses=T):
    count = len(T)
    images = np.zeros((count, 16, 16), np.uint8)
    return Frames(images, list("abcd"), np.arange(count), CAMERA, np.arange(count), poses)


def motions(odometry, seed=1):
    poses = odometry.extract(frames())
    rng = np.random.default_rng(seed)
    return [odometry.estimate(poses[i], poses[i + 1], rng) for i in range(3)]


def test_conforms():
    check_odometry(Simulated(), frames())


def test_without_noise_it_is_the_motion_in_the_first_frame():
    estimates = motions(
        Simulated(translation_noise=0, still_noise_m=1e-12, heading_noise_deg=1e-9, turn_noise=0, scale=3)
    )
    expected = TRUE * [3, 3, 1]
    expected[1, 2] = np.deg2rad(100)
    assert np.allclose([m.vector for m in estimates], expected, atol=1e-9)
    assert {m.unit for m in estimates} == {"m"}


@pytest.mark.parametrize("step", [0, 1, 2])
def test_its_covariance_is_that_of_its_noise(step):
    odometry = Simulated(0.1, 0.01, 2.0, 0.1)
    poses = odometry.extract(frames())
    rng = np.random.default_rng(4)
    estimates = [odometry.estimate(poses[step], poses[step + 1], rng) for _ in range(2000)]
    off = np.array([m.vector for m in estimates]) - TRUE[step]
    chi2 = np.einsum("ni,ij,nj->n", off, np.linalg.inv(estimates[0].covariance), off)
    assert stats.kstest(chi2, stats.chi2(3).cdf).pvalue > 0.001
    assert np.allclose(
        np.cov(off.T), estimates[0].covariance, atol=4 * np.sqrt(2 / 2000) * np.diag(estimates[0].covariance).max()
    )


def test_the_noise_grows_with_the_step_and_with_the_turn():
    straight, turning, _ = (np.sqrt(np.diag(m.covariance)) for m in motions(Simulated(0.1, 0.01, 2.0, 0.1)))
    assert straight == pytest.approx([np.hypot(0.1, 0.01)] * 2 + [np.deg2rad(2)])
    assert turning == pytest.approx([0.01, 0.01, np.deg2rad(np.hypot(2, 10))])


def test_the_noise_is_of_the_seed():
    one, same, other = (np.array([m.vector for m in motions(Simulated(), seed)]) for seed in (1, 1, 2))
    assert np.array_equal(one, same)
    assert not np.allclose(one, other)


def test_says_what_is_missing_or_wrong():
    with pytest.raises(DataError, match="needs the poses that it spoils"):
        Simulated().extract(frames(None))
    for wrong in ({"translation_noise": -1}, {"still_noise_m": 0}, {"heading_noise_deg": float("nan")}):
        with pytest.raises(ConfigError, match=f"{next(iter(wrong))}=.*; give a number from"):
            Simulated(**wrong)
    with pytest.raises(ConfigError, match="scale=0 is out of range"):
        Simulated(scale=0)
