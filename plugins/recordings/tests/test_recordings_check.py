"""`omnilab check`: what it says of folders whose defects are known, and of rendered ones whose truth is known."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnilab.api import GridPoses
from omnilab.cameras import UnifiedCamera, save_camera
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import wrap_angle
from omnilab_recordings import register_commands
from omnilab_recordings.checks.command import check
from omnilab_recordings.checks.handedness import drift_between, handedness, horizon

FOREST = Path(__file__).resolve().parents[4] / "shared" / "data" / "bearingnet_forest_grid"


@pytest.fixture
def run(tmp_path_factory, capsys, monkeypatch):
    """Run the command; its findings, by topic. It leaves the folder as it is, and draws a picture if asked to."""

    def run(folder, *options, draw=False):
        if not draw:
            monkeypatch.setattr("omnilab_recordings.checks.command.write_report_picture", lambda *_: None)
        picture = tmp_path_factory.mktemp("out") / "found.png"
        before = sorted(Path(folder).rglob("*"))
        assert check([str(folder), "-o", str(picture), *options]) == 0
        assert sorted(Path(folder).rglob("*")) == before
        if draw:
            assert cv2.imread(str(picture)).shape[0] > 500
        lines = [line.split(None, 2) for line in capsys.readouterr().out.splitlines()[1:-1]]
        return {topic: (mark, text.strip()) for mark, topic, text in map(_joined, lines)}

    return run


def _joined(words):
    mark, topic, text = words
    return (mark, "same pose", text.removeprefix("pose")) if topic == "same" else (mark, topic, text)


def ring_images(count, seed=0):
    """A ring of texture around (60, 50), radius 40, in a dark frame."""
    rng = np.random.default_rng(seed)
    v, u = np.indices((100, 120))
    inside = np.hypot(u - 60, v - 50) <= 40
    textures = [cv2.GaussianBlur(rng.uniform(-400, 600, inside.shape), (0, 0), 3) + 30 for _ in range(count)]
    return [np.where(inside, np.clip(texture, 60, 220), 3).astype(np.uint8) for texture in textures]


# ---------------------------------------------------------------------------------------------------- what drifts tell
@settings(deadline=None, max_examples=30)
@given(st.floats(-np.pi, np.pi), st.floats(2, 5), st.floats(-3, 3), st.integers(0, 99))
def test_the_move_is_where_things_flow_away_from(move, speed, turn, seed):
    """Panoramas warped by the closed form: speed sin(azimuth - move) sideways, and apart at row 24 of 64."""
    noise = np.random.default_rng(seed).uniform(0, 255, (64, 512))
    picture = cv2.GaussianBlur(np.hstack([noise, noise, noise]), (0, 0), 3)[:, 512:-512]
    picture = cv2.normalize(picture, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    row, column = np.indices(picture.shape)
    azimuth = 2 * np.pi * column / 512
    back_u = column - speed * np.sin(azimuth - move) - turn
    back_v = row - (row - 24) / 20 * np.cos(azimuth - move)
    wrapped = np.hstack([picture[:, -64:], picture, picture[:, :64]])
    after = cv2.remap(
        wrapped,
        (back_u + 64).astype(np.float32),
        back_v.astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    seen, parting = drift_between(picture, after)
    assert abs(wrap_angle(seen - move)) < np.deg2rad(8)
    found = horizon(np.tile(parting, (6, 1)))
    assert found.level == pytest.approx(1 - 24 / 64, abs=0.08)
    assert found.upright


@given(st.floats(-np.pi, np.pi), st.booleans(), st.integers(0, 999))
def test_handedness_from_exact_drifts(turned, mirrored, seed):
    moves = np.random.default_rng(seed).uniform(-np.pi, np.pi, 24)
    azimuth = moves + turned
    found = handedness(np.pi - azimuth if mirrored else azimuth, moves)
    assert found.is_mirrored is mirrored
    assert abs(wrap_angle(np.deg2rad(found.turned_deg) - turned)) < 1e-9


def test_handedness_cannot_be_decided_from_one_line_or_from_noise():
    to_and_fro = np.array([0.0, np.pi] * 10)
    assert handedness(to_and_fro + 0.3, to_and_fro).is_mirrored is None
    noise = np.random.default_rng(0).uniform(-np.pi, np.pi, (2, 40))
    assert handedness(*noise).is_mirrored is None
    assert handedness(np.zeros(0), np.zeros(0)).is_mirrored is None


def test_no_horizon_without_motion():
    assert horizon(np.zeros((9, 64))) is None
    assert horizon(np.tile(np.linspace(-1, 1, 64), (3, 1))) is None  # too few pairs


# ------------------------------------------------------------------------------------------------- rendered truth
@pytest.mark.slow  # the renderer is compiled
@pytest.mark.parametrize(("mirrored", "turned_deg"), [(False, 0), (True, 70)])
def test_a_rendered_room_is_seen_through(run, tmp_path, mirrored, turned_deg):
    mirror = pytest.importorskip("omnilab_mirror").Mirror(size=160, crop=1.0)
    plan = mirror.plan(GridPoses(step_m=0.8, extent_m=(3.2, 3.2)))
    lines, number = ["image,x_m,y_m,yaw_deg"], 0
    for frames in mirror.frames(plan):
        for image, T in zip(frames.images, frames.T_world_camera, strict=True):
            picture = image[:, ::-1] if mirrored else image
            cv2.imwrite(str(tmp_path / f"{number}.png"), np.ascontiguousarray(picture))
            lines.append(f"{number}.png,{float(T[0, 3])!r},{float(T[1, 3])!r},{turned_deg}")
            number += 1
    (tmp_path / "positions.csv").write_text("\n".join(lines) + "\n")
    findings = run(tmp_path)
    mark, text = findings["handedness"]
    assert mark == "ok"
    assert text.startswith(f"sensor.mirrored={str(mirrored).lower()} ")
    found = int(text.split("turned_deg=")[1].split()[0])
    assert abs(wrap_angle(np.deg2rad(found - turned_deg))) < np.deg2rad(15)
    assert findings["circle"][0] == "ok"


def test_the_forest_is_what_it_is_known_to_be(run):
    if not FOREST.is_dir():
        pytest.skip("the forest recording is not at hand")
    findings = run(FOREST, "--circle", "512", "512", "455", "150", "--sky-inside")
    assert findings["handedness"][1].startswith("sensor.mirrored=false sensor.turned_deg=1")
    assert abs(int(findings["handedness"][1].split("turned_deg=")[1].split()[0]) - 180) < 10
    assert findings["horizon"][0] == "ok"
    assert abs(int(findings["horizon"][1].split()[1]) - 256) < 30
    assert findings["grid"] == ("ok", "10 × 10 grid at 1.0 m")


# ------------------------------------------------------------------------------------------------------ known defects
def test_a_sound_folder(run, write_recording):
    root = write_recording(ring_images(9), [f"img-{i}.png,{i % 3},{i // 3}" for i in range(9)])
    findings = run(root, draw=True)
    assert findings["images"] == ("ok", "9 images, 120 x 100 pixels")
    mark, text = findings["circle"]
    assert mark == "ok"
    assert text.startswith("centre (60.")
    assert findings["exposure"][0] == findings["poses"][0] == findings["grid"][0] == "ok"
    assert findings["handedness"][0] == "?"  # unrelated textures
    assert not {"sizes", "unreadable", "duplicates"} & set(findings)


def test_what_is_wrong_with_files_is_reported(run, write_recording):
    images = ring_images(12)
    images[3], images[5], images[7] = images[2], images[5] // 8, images[7][:80]
    images[9] = np.where(images[9] > 60, 255, images[9])
    root = write_recording(images)
    (root / "img-11.png").write_bytes(b"no image")
    findings = run(root)
    assert findings["unreadable"] == ("look", "1 cannot be read: img-11.png is truncated or no image")
    assert findings["sizes"] == ("look", "1 have another size: img-7.png (120 x 80)")
    assert findings["duplicates"] == ("look", "1 groups of files have the same pixels: img-2.png = img-3.png")
    mark, text = findings["exposure"]
    assert mark == "look"
    assert "1 darker than 25 (img-5.png)" in text
    assert "1 with over 10% of the pixels at white (img-9.png)" in text
    assert findings["poses"] == ("?", "none: write a positions.csv, or give --names")


def test_holes_and_poses_that_occur_twice_are_reported(run, write_recording):
    rows = [f"img-{i}.png,{i % 3},{i // 3}" for i in range(8)] + ["img-8.png,1,1"]
    findings = run(write_recording(ring_images(9), rows))
    assert findings["grid"] == ("look", "3 × 3 grid at 1.0 m; 1 places without image (column 2, row 2)")
    assert findings["same pose"][1].endswith("1 pairs of images: img-4.png and img-8.png")


@pytest.mark.parametrize(("options", "rows", "sentence"), [
    ((), ["img-0.png,0,0"], "does not name 2 that are"),
    (("--names", "bielefeld"), None, "3 of 3 image names do not match"),
])  # fmt: skip
def test_poses_that_cannot_be_read_do_not_hide_the_rest(run, write_recording, options, rows, sentence):
    findings = run(write_recording(ring_images(3), rows), *options)
    assert findings["poses"][0] == "look"
    assert sentence in findings["poses"][1]
    assert findings["circle"][0] == "ok"


def test_no_circle_and_a_guessed_one(run, write_recording, tmp_path):
    square = np.full((60, 80), 3, np.uint8)
    square[5:55, 30:36] = 200
    text = run(write_recording([square] * 2))["circle"][1]
    assert "no image circle stands out" in text
    assert "circle_px=[cx,cy,radius]" in text
    for file in tmp_path.glob("*.png"):
        file.unlink()
    filled = run(
        write_recording([np.random.default_rng(i).integers(99, 255, (60, 80), dtype=np.uint8) for i in range(2)])
    )
    assert filled["circle"][0] == "?"


def test_a_calibration_is_named_with_what_it_shows(run, write_recording):
    root = write_recording(ring_images(3))
    save_camera(
        UnifiedCamera(width=120, height=100, cx=60, cy=50, fx=30, fy=30, xi=1.0, rim_px=40),
        root / "camera.json",
    )
    findings = run(root, draw=True)
    assert findings["camera"][1].startswith("UnifiedCamera; centre (60.0, 50.0), radius 40.0")
    # of a stereographic image, the radius is f tan(45 degrees + elevation / 2)
    top = round(2 * np.rad2deg(np.arctan(40 / 30)) - 90)
    assert findings["horizon"] == ("ok", f"the camera shows elevations from -90 to {top} degrees")


def test_what_cannot_be_checked(write_recording, tmp_path):
    with pytest.raises(DataError, match="does not exist"):
        check([str(tmp_path / "nowhere")])
    root = write_recording(ring_images(2))
    with pytest.raises(ConfigError, match="would lie among the images"):
        check([str(root), "-o", str(root / "found.png")])
    with pytest.raises(ConfigError, match="cannot be written"):
        check([str(root), "-o", str(root.parent / "none" / "found.png")])
    for file in root.glob("*.png"):
        file.write_bytes(b"")
    with pytest.raises(DataError, match="can be read"):
        check([str(root), "-o", str(root.parent / "found.png")])


def test_the_commands():
    commands = {}
    register_commands(lambda name, command: commands.update({name: command}))
    assert sorted(commands) == ["calibrate", "camera", "check", "convert", "dataset"]
    assert commands["check"].load() is check
