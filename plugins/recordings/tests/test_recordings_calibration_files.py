"""Calibrations of other tools beside recorded images: read by the sensor and by `omnilab check`, questions answered by settings."""

from __future__ import annotations

import json

import numpy as np
import pytest

from omnilab.api import RecordedPoses
from omnilab.cameras import BrownConradyCamera, KannalaBrandtCamera, OCamCamera, UnifiedCamera
from omnilab.errors import ConfigError, DataError
from omnilab_recordings import Folder
from omnilab_recordings.checks.command import check

CAMCHAIN = """cam0:
  camera_model: omni
  distortion_coeffs: [-0.05, 0.19, -0.001, 0.001]
  distortion_model: radtan
  intrinsics: [1.2, 60.0, 60.0, 63.5, 63.5]
  resolution: [128, 128]
cam1:
  camera_model: pinhole
  distortion_coeffs: [0.01, 0.0, 0.0, 0.0]
  distortion_model: equidistant
  intrinsics: [40.0, 40.0, 63.5, 63.5]
  resolution: [128, 128]
"""
OPENCV = "K: [[40, 0, 63.5], [0, 40, 63.5], [0, 0, 1]]\nD: [0.01, 0, 0, 0]\n"
OCAM = {
    "taylor_coefficient": [40.0, 0.0, -0.01], "distortion_center": [63.5, 63.5], "stretch_matrix": [[1, 0], [0, 1]],
}  # fmt: skip


@pytest.fixture
def folder(write_recording):
    rng = np.random.default_rng(0)
    root = write_recording([rng.integers(0, 255, (128, 128), dtype=np.uint8) for _ in range(3)])
    (root / "camchain.yaml").write_text(CAMCHAIN)
    (root / "lens.json").write_text(json.dumps(OCAM))
    (root / "opencv.yml").write_text(OPENCV)
    return root


def camera_of(folder, **settings):
    sensor = Folder(folder, **settings)
    (frames,) = sensor.frames(sensor.plan(RecordedPoses()))
    return frames.camera


@pytest.mark.parametrize(("settings", "model", "z"), [
    ({"camera": "camchain.yaml", "entry": "cam0"}, UnifiedCamera, -1),
    ({"camera": "camchain.yaml", "entry": "cam1", "looks": "up"}, KannalaBrandtCamera, 1),
    ({"camera": "lens.json"}, OCamCamera, -1),
    ({"camera": "opencv.yml", "distortion": "radtan"}, BrownConradyCamera, 0),
    ({"camera": "opencv.yml", "distortion": "equidistant"}, KannalaBrandtCamera, -1),
])  # fmt: skip
def test_the_pictures_get_the_camera_of_the_file(folder, settings, model, z):
    camera = camera_of(folder, **settings)
    assert isinstance(camera, model)
    assert (camera.width, camera.height) == (128, 128)
    assert camera.directions(np.array([63.5, 63.5]))[2] == pytest.approx(z)
    assert camera_of(folder, **settings, mirrored=True) == camera.flipped()


@pytest.mark.parametrize(("file", "sentence", "follow"), [
    ("camchain.yaml", "give entry=cam0 or entry=cam1 (sensor.entry=cam0 in a run, --entry of omnilab check)", "entry=cam0"),
    ("opencv.yml", "(sensor.distortion=radtan in a run, --distortion of omnilab check)", "distortion=radtan"),
])  # fmt: skip
def test_what_a_file_leaves_open_is_asked_and_the_answer_works(
    folder, tmp_path_factory, capsys, file, sentence, follow
):
    with pytest.raises(ConfigError) as asked:
        camera_of(folder, camera=file)
    assert sentence in str(asked.value)
    assert follow in str(asked.value)
    name, _, value = follow.partition("=")
    camera_of(folder, camera=file, **{name: value})
    picture = tmp_path_factory.mktemp("out") / "check.png"
    with pytest.raises(ConfigError, match=follow):
        check([str(folder), "--camera", file, "-o", str(picture)])
    assert check([str(folder), "--camera", file, f"--{name}", value, "-o", str(picture)]) == 0
    assert picture.stat().st_size > 1000


def test_a_calibration_of_another_size_is_refused_with_both(folder):
    for size in ("[256, 256]", "[128, 100]"):
        (folder / "camchain.yaml").write_text(CAMCHAIN.replace("[128, 128]", size))
        with pytest.raises(
            DataError, match=r"is of images of \d+ x \d+ pixels, these have 128 x 128; give the calibration"
        ):
            camera_of(folder, camera="camchain.yaml", entry="cam1")


def test_a_calibration_of_pictures_turned_by_a_quarter_is_told(write_recording):
    root = write_recording([np.zeros((100, 128), np.uint8)])
    (root / "camchain.yaml").write_text(CAMCHAIN.replace("[128, 128]", "[100, 128]"))
    with pytest.raises(DataError, match=r"of 100 x 128 pixels, these have 128 x 100; .*turned by 90 degrees"):
        camera_of(root, camera="camchain.yaml", entry="cam1")


@pytest.mark.parametrize("settings", [{"entry": "cam0"}, {"distortion": "radtan"}, {"looks": "up"}])
def test_settings_of_a_camera_without_a_camera(folder, settings):
    with pytest.raises(ConfigError, match=r"is given without a camera; give sensor\.camera=FILE, or leave it out"):
        camera_of(folder, **settings)
