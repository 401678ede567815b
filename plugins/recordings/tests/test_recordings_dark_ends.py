"""Spheres whose ends are dark are taken neither for mirrors nor for strips."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from omnilab.api import RecordedPoses
from omnilab.errors import DataError
from omnilab_recordings import Folder


def sphere(seed, share):
    """A smooth picture of 256 x 128, dark towards its left and right edges, as a seam may be."""
    rng = np.random.default_rng(seed)
    azimuth, level = np.meshgrid(np.linspace(0, 2 * np.pi, 256, endpoint=False), np.linspace(-1, 1, 128))
    waves = sum(
        rng.normal() * np.cos(k * azimuth + rng.uniform(0, 6)) * np.cos(m * level + rng.uniform(0, 6))
        for k in range(1, 9) for m in range(4)
    )  # fmt: skip
    bright = np.clip((1 - np.abs(azimuth / np.pi - 1)) / share, 0, 1)
    return (np.clip(128 + 30 * waves, 40, 255) * bright).round().astype(np.uint8)


@pytest.mark.parametrize("count", [1, 4])
@pytest.mark.parametrize("share", [0.25, 0.5])
def test_spheres_with_dark_ends_are_no_mirrors_and_no_strips(tmp_path, caplog, count, share):
    for i in range(count):
        assert cv2.imwrite(str(tmp_path / f"{i}.png"), sphere(i, share))
    try:
        said = Folder(tmp_path).remarks["panorama"]
    except DataError as error:
        said = str(error)
    assert "the pictures are 2:1" in said
    assert "as equirectangular panoramas are: give sensor.panorama=equirectangular" in said
    sensor = Folder(tmp_path, panorama="equirectangular")  # and declared to be spheres they are not called mirrors
    assert sum(len(frames) for frames in sensor.frames(sensor.plan(RecordedPoses()))) == count
    assert "circle" not in caplog.text
