"""Virtual cameras of calibration files, and cameras that see nothing."""

import pytest

import omnilab_mirror
from omnilab.errors import ConfigError


def test_a_calibrated_sensor_answers_what_a_file_leaves_open(tmp_path):
    file = tmp_path / "pair.yml"
    rows = "[[40, 0, 31.5], [0, 40, 23.5], [0, 0, 1]]"
    file.write_text(f"K1: {rows}\nD1: [0.01, 0, 0, 0]\nK2: {rows}\nD2: [0.01, 0, 0, 0]\n")
    answers = {"entry": "2", "distortion": "equidistant", "size_px": [64, 48]}
    for lacking, sentence in (
        ("entry", "give entry=1 or"),
        ("distortion", "=radtan or"),
        ("size_px", r"size_px=\[WIDTH"),
    ):
        with pytest.raises(ConfigError, match=sentence):
            omnilab_mirror.Calibrated(file=str(file), **{k: v for k, v in answers.items() if k != lacking})
    camera = omnilab_mirror.Calibrated(file=str(file), **answers, looks="up").camera
    assert (camera.width, camera.looks, camera.k1) == (64, "up", 0.01)


@pytest.mark.parametrize(("name", "settings", "sentence"), [
    ("Mirror", {"b_mm": 1e-300}, "a HyperbolicMirror of these numbers sees nothing"),
    ("Unified", {"fx": 1e-300}, "fx=1e-300, fy=40, xi=0.9 is no camera"),
    ("Unified", {"xi": 1e9}, "a UnifiedCamera of these numbers sees nothing"),
    ("Pinhole", {"focal_px": 1e11}, "a PinholeCamera of these numbers sees nothing"),
])  # fmt: skip
def test_a_virtual_camera_that_sees_nothing_is_refused(name, settings, sentence):
    with pytest.raises(ConfigError, match=sentence):
        getattr(omnilab_mirror, name)(**settings)
