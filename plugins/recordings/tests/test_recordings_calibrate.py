"""The commands calibrate and camera, from rendered boards to a run with the camera that comes out."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from omnilab.api import RecordedPoses
from omnilab.cameras import UnifiedCamera, load_camera
from omnilab.cameras.calibration import Board, Corners, board_poses, render_board, write_corners
from omnilab.errors import ConfigError, DataError
from omnilab_recordings import Folder
from omnilab_recordings.checkerboards.camera_command import camera_command
from omnilab_recordings.checkerboards.command import calibrate_command
from omnilab_recordings.checkerboards.coverage_picture import magnification

BOARD = Board(4, 5, 0.03)
CAMERA = UnifiedCamera(width=320, height=240, cx=161.3, cy=118.2, fx=150.0, fy=150.0, xi=0.9)
SETTINGS = ["--board", "4x5", "--square", "30mm", "--model", "unified"]
DATA = Path(__file__).resolve().parents[4] / "shared/data"
COUNT = 7
DISTANCES = 5.0 + np.arange(COUNT) % 3  # squares


def picture(i: int) -> np.ndarray:
    directions, tilts = [([8, 35, 46, 28][i % 4], 137.5 * i)], [(25 * (-1) ** i, 17 * (i % 3 - 1))]
    R, t = board_poses(BOARD, directions, [DISTANCES[i]], tilts, [46 * i])
    return cv2.GaussianBlur(render_board(CAMERA, BOARD, R[0], t[0]), (0, 0), 0.6)


@pytest.fixture(scope="module")
def pictures() -> list[np.ndarray]:
    return [picture(i) for i in range(COUNT)]


@pytest.fixture
def boards(tmp_path: Path, pictures: list[np.ndarray]) -> Path:
    folder = tmp_path / "boards"
    folder.mkdir()
    for i, image in enumerate(pictures):
        cv2.imwrite(str(folder / f"{i}.png"), image)
    return folder


def test_from_pictures_to_a_sensor_with_their_camera(boards, tmp_path, capsys):
    cv2.imwrite(str(boards / "empty.png"), np.full((240, 320), 90, np.uint8))
    (boards / "torn.png").write_bytes((boards / "0.png").read_bytes()[:300])
    camera = tmp_path / "camera.json"
    assert (
        calibrate_command([str(boards), *SETTINGS, "-o", str(camera), "--save-corners", str(tmp_path / "c.csv")]) == 0
    )
    text = capsys.readouterr().out
    for part in (
        "left out: empty.png shows no board of 4x5",
        "left out: torn.png",
        "px rms over 7 boards",
        "3.png",
        "chosen",
    ):
        assert part in text
    found = load_camera(camera)
    assert np.allclose([found.cx, found.cy], [CAMERA.cx, CAMERA.cy], atol=1.5)
    report = json.loads((tmp_path / "camera_calibration.json").read_text())
    assert report["rms_px"] < 0.1
    assert np.shape(report["covariance"]) == (5, 5)
    assert {board["image"] for board in report["boards"]} == {f"{i}.png" for i in range(COUNT)}
    assert report["boards"][0]["distance_m"] == pytest.approx(DISTANCES[0] * 0.03, rel=0.03)
    assert cv2.imread(str(tmp_path / "camera.png")).shape == (720, 1400, 3)
    sensor = Folder(str(boards), positions=None, camera=str(camera), pattern="[0-9].png")
    (frames,) = sensor.frames(sensor.plan(RecordedPoses()))
    assert frames.camera == found
    again = ["--corners", str(tmp_path / "c.csv"), "--size", "320x240", *SETTINGS, "-o", str(tmp_path / "again.json")]
    assert calibrate_command(again) == 0  # and by the table of corners the same
    assert load_camera(tmp_path / "again.json") == found


@pytest.mark.parametrize(("arguments", "sentence"), [
    (["--board", "3x4"], "goes on beyond 3x4 inner corners in .* to 4x5 or more|show a board of 3x4 .* one of 4x5; give --board 4x5"),
    (["--board", "5x6"], "0 of the pictures show a board of 5x6 inner corners, and others one of 4x5; give --board 4x5"),
    (["--square", "30"], "--square 30 has no unit; give 30mm, 30cm or 30m"),
    (["-o", "camera.txt"], "cannot be written to camera.txt; give -o FILE.json"),
    (["-o", "DIR/camera.json"], "would lie among the pictures"),
    (["--size", "320x240"], "--size 320x240 is given without --corners"),
    (["--pattern", "*.tif"], "holds no pictures"),
])  # fmt: skip
def test_mistakes(boards, tmp_path, monkeypatch, arguments, sentence):
    monkeypatch.chdir(tmp_path)
    for file in sorted(boards.iterdir())[5:]:
        file.unlink()
    given = [text.replace("DIR", str(boards)) for text in arguments]
    with pytest.raises((ConfigError, DataError), match=sentence):
        calibrate_command([str(boards), *SETTINGS, *given])


@pytest.mark.slow
def test_swapped_counts_are_the_same_board(boards, tmp_path):
    for name, board in {"a": "4x5", "b": "5x4"}.items():
        calibrate_command([str(boards), *SETTINGS, "--board", board, "-o", str(tmp_path / f"{name}.json")])
    a, b = (load_camera(tmp_path / f"{name}.json") for name in "ab")
    assert np.allclose([a.cx, a.cy, a.fx, a.xi], [b.cx, b.cy, b.fx, b.xi], rtol=1e-4)


def test_pictures_of_two_sizes_or_turned_are_refused(boards, tmp_path):
    cv2.imwrite(str(boards / "wide.png"), np.zeros((240, 400), np.uint8))
    with pytest.raises(
        DataError, match=r"have 2 sizes \(320 x 240: 7, such as 0.png, 400 x 240: 1, such as wide.png\)"
    ):
        calibrate_command([str(boards), *SETTINGS, "-o", str(tmp_path / "camera.json")])
    (boards / "wide.png").unlink()
    _, data = cv2.imencode(".jpg", cv2.imread(str(boards / "0.png"), 0))
    exif = b"Exif\0\0MM\0*" + struct.pack(">IHHHIHHI", 8, 1, 0x0112, 3, 1, 3, 0, 0)
    head = b"\xff\xd8\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif
    (boards / "turned.jpg").write_bytes(head + data.tobytes()[2:])
    with pytest.raises(DataError, match=r"turned in 2 ways by their EXIF tags .*; give --ignore-exif-orientation"):
        calibrate_command([str(boards), *SETTINGS, "-o", str(tmp_path / "camera.json")])


def test_what_is_there_is_not_replaced_unasked(tmp_path):
    (tmp_path / "camera.png").write_text("mine")
    with pytest.raises(ConfigError, match=r"camera.png exist\(s\); give another -o FILE.json, or --overwrite"):
        calibrate_command([str(tmp_path / "boards"), *SETTINGS, "-o", str(tmp_path / "camera.json")])
    assert (tmp_path / "camera.png").read_text() == "mine"


def test_arrows_are_magnified_by_round_numbers():
    assert magnification(0.1, 1000) == 200
    assert magnification(0.3, 1000) == 100
    assert magnification(3.1, 100) == 0.5


# ---------------------------------------------------------------------------------------------------------- camera convert
def test_a_camera_is_converted(tmp_path, capsys):
    from omnilab.cameras import save_camera

    save_camera(CAMERA, tmp_path / "camera.json")
    assert (
        camera_command(["convert", str(tmp_path / "camera.json"), "--to", "kalibr", "-o", str(tmp_path / "k.yaml")])
        == 0
    )
    assert load_camera(tmp_path / "k.yaml", looks="down") == CAMERA
    with pytest.raises(ConfigError, match="no UnifiedCamera; give --refit ocam, which says what it costs"):
        camera_command(["convert", str(tmp_path / "camera.json"), "--to", "ocamcalib", "-o", str(tmp_path / "o.txt")])
    refitted = [
        "convert",
        str(tmp_path / "camera.json"),
        "--to",
        "ocamcalib",
        "--refit",
        "ocam",
        "-o",
        str(tmp_path / "o.txt"),
    ]
    assert camera_command(refitted) == 0
    assert "px rms from where the camera does" in capsys.readouterr().out
    assert load_camera(tmp_path / "o.txt").width == 320


# ------------------------------------------------------------------------------------------------------------- real boards
@pytest.mark.slow
@pytest.mark.parametrize(("folder", "board", "square", "most_px", "fewest", "center"), [
    ("calib_ocamcalib/VMRImage", "6x7", "30mm", 0.4, 9, (514.4, 383.3)),
    ("calib_ocamcalib/Fisheye2", "6x8", "117mm", 0.2, 14, (384.8, 240.1)),
    ("ocam_fisheye_calib/fish_1", "6x8", "32.5mm", 0.45, 13, (543.99, 377.65)),
])  # fmt: skip
def test_real_boards(tmp_path, folder, board, square, most_px, fewest, center):
    """On boards left out; the axis where others found it (SOURCE.txt, py-OCamCalib)."""
    if not (DATA / folder).is_dir():
        pytest.skip(f"{DATA / folder} is not there")
    calibrate_command([str(DATA / folder), "--board", board, "--square", square, "-o", str(tmp_path / "camera.json")])
    report = json.loads((tmp_path / "camera_calibration.json").read_text())
    assert report["left_out_boards_px"] < most_px
    assert len(report["boards"]) >= fewest
    found = load_camera(tmp_path / "camera.json")
    assert np.hypot(found.cx - center[0], found.cy - center[1]) < 3
    if folder.endswith("fish_1"):
        reference = load_camera(DATA / "ocam_fisheye_calib/calibration_fisheye_1.json", size=(1032, 778))
        v, u = np.mgrid[60:720:60, 160:920:60].astype(float)
        pixels = np.stack([u, v], -1).reshape(-1, 2)
        pixels = pixels[np.hypot(*(pixels - center).T) < 440]  # as far as corners were seen
        rays, others = found.rays(pixels), reference.rays(pixels)
        U, _, Vt = np.linalg.svd(others.T @ rays)
        assert np.linalg.norm(found.image_points(others @ U @ Vt) - pixels, axis=-1).max() < 1


def test_corners_of_another_detector_need_the_size(tmp_path):
    corners = Corners(BOARD, 320, 240, ("a",), np.full((1, 20, 2), 50.0) + np.arange(20)[:, None])
    write_corners(tmp_path / "c.csv", corners)
    with pytest.raises(ConfigError, match="--size None is no size; with --corners give that of the pictures"):
        calibrate_command(["--corners", str(tmp_path / "c.csv"), *SETTINGS, "-o", str(tmp_path / "camera.json")])
