"""Cameras written to files and read back."""

from __future__ import annotations

import json

import pytest

from omnilab.cameras import (
    EIZOH_WIDE_70,
    CylindricalCamera,
    EquirectangularCamera,
    FisheyeCamera,
    ImageCircle,
    OCamCamera,
    ParabolicMirror,
    PinholeCamera,
    UnifiedCamera,
    load_camera,
    save_camera,
)
from omnilab.errors import ConfigError, DataError

FRAME = {"width": 640, "height": 480, "cx": 320.5, "cy": 239.25}
CAMERAS = [
    EIZOH_WIDE_70,
    ParabolicMirror(),
    CylindricalCamera(512, 128, start_deg=90, clockwise=True, lowest_deg=-30),
    EquirectangularCamera(512, 256),
    FisheyeCamera(**FRAME, focal_px=150.5, looks="up"),
    OCamCamera(**FRAME, polynomial=(-180.0, 0.0, 0.0007, -1e-7), c=1.01, d=-0.002, e=0.003, inner_px=20),
    PinholeCamera(**FRAME, focal_px=400),
    UnifiedCamera(**FRAME, fx=425.19303, fy=424.86463, xi=0.98754, rim_px=430.0),
]


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: type(camera).__name__)
def test_a_camera_comes_back_as_it_was(camera, tmp_path):
    save_camera(camera, tmp_path / "camera.json")
    assert load_camera(tmp_path / "camera.json") == camera


def test_paths_may_be_texts(tmp_path):
    save_camera(CAMERAS[0], str(tmp_path / "camera.json"))
    assert load_camera(str(tmp_path / "camera.json")) == CAMERAS[0]


def test_a_camera_without_a_model_cannot_be_written(tmp_path):
    with pytest.raises(ConfigError, match=r"a ImageCircle cannot be written .*OCamCamera"):
        save_camera(ImageCircle(10, 10, None), tmp_path / "camera.json")


GOOD = {"model": "PinholeCamera", **FRAME, "focal_px": 400}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"model": "Pinhole"}, "the model 'Pinhole'; give one of BrownConradyCamera, ConicalMirror"),
        ({"focal": 3}, r"unknown key 'focal' \(did you mean focal_px\?\)"),
        ({"focal_px": "long"}, "focal_px='long'; write a value of type float"),
        ({"focal_px": True}, "focal_px=True; write a value of type float"),
        ({"focal_px": float("nan")}, "focal_px=nan; write a value of type float"),
        ({"width": 3.5}, "width=3.5; write a value of type int"),
        ({"focal_px": [1, 2]}, "write a value of type float"),
        ({"focal_px": -1}, "focal_px=-1 is no focal length"),
        ({"rim_px": None, "looks": "sideways"}, "looks='sideways' is not known"),
    ],
)
def test_what_is_wrong_with_a_file_is_said(change, words, tmp_path):
    file = tmp_path / "camera.json"
    file.write_text(json.dumps(GOOD | change))
    with pytest.raises(DataError, match=words):
        load_camera(file)


def test_what_lacks_in_a_file_is_said(tmp_path):
    file = tmp_path / "camera.json"
    file.write_text(json.dumps({k: v for k, v in GOOD.items() if k != "focal_px"}))
    with pytest.raises(DataError, match="lacks focal_px of a PinholeCamera; add"):
        load_camera(file)


@pytest.mark.parametrize(
    ("text", "words"), [("[]", "holds a list"), ("{", "is not JSON"), ("[" * 100_000, "is not JSON")]
)
def test_a_file_of_another_kind_is_refused(text, words, tmp_path):
    file = tmp_path / "camera.json"
    file.write_text(text)
    with pytest.raises(DataError, match=words):
        load_camera(file)
    with pytest.raises(DataError, match="cannot be read"):
        load_camera(tmp_path / "absent.json")
