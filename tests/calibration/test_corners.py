"""Corners found in rendered boards, beside where they are; boards of other counts; tables of corners."""

import cv2
import numpy as np
import pytest
from rendered_boards import apart_px, exact, many_poses

from omnilab.cameras import KannalaBrandtCamera, UnifiedCamera
from omnilab.cameras.calibration import (
    MODELS,
    Board,
    Corners,
    board_poses,
    calibrate,
    find_corners,
    other_board,
    read_corners,
    render_board,
    whole_size,
    write_corners,
)
from omnilab.cameras.calibration.board import front_side
from omnilab.errors import DataError

BOARD = Board(6, 8, 0.03)
CAMERA = KannalaBrandtCamera(width=640, height=480, cx=325.3, cy=236.8, fx=170.0, fy=171.0, k1=-0.02, k2=0.004)
POSE = board_poses(BOARD, [(30, 60)], [6], [(20, -15)], [30])


def picture(camera=CAMERA, R=POSE[0][0], t=POSE[1][0], samples=3):
    return cv2.GaussianBlur(render_board(camera, BOARD, R, t, samples), (0, 0), 0.7)


def test_corners_lie_where_they_are():
    found = find_corners(picture(), BOARD)
    truth = exact(CAMERA, BOARD, *POSE).pixels[0]
    off = min(
        np.linalg.norm(turned - truth, axis=-1).max() for turned in (found, found[::-1])
    )  # a board has no first end
    assert off < 0.25


@pytest.mark.parametrize("turn", [
    lambda image: image[:, ::-1].copy(), lambda image: 255 - image, lambda image: image // 6 + 20,
])  # fmt: skip
def test_boards_in_a_mirror_of_other_colours_or_in_the_dark_are_found(turn):
    found = find_corners(turn(picture()), BOARD)
    assert found is not None
    assert np.array_equal(found, front_side(found, 6, 8))


def test_no_board_where_there_is_none():
    noise = np.random.default_rng(0).integers(0, 255, (120, 160)).astype(np.uint8)
    assert find_corners(noise, BOARD) is None
    assert find_corners(np.full((120, 160), 90, np.uint8), BOARD) is None


def test_a_board_is_seen_to_go_on_and_to_end():
    image, whole = picture(), exact(CAMERA, BOARD, *POSE).pixels[0]
    part = whole.reshape(6, 8, 2)[1:5, 1:7].reshape(-1, 2)
    assert whole_size(image, part, Board(4, 6, 0.03)) == (6, 8)
    assert whole_size(image, whole, BOARD) == (6, 8)


def test_the_board_that_is_there_is_named():
    assert other_board([picture()], Board(7, 9, 0.03)) == BOARD  # squares were counted
    assert other_board([np.full((120, 160), 90, np.uint8)], BOARD) is None


@pytest.mark.slow
@pytest.mark.parametrize(("name", "camera"), [
    ("kannala_brandt", CAMERA),
    ("unified", UnifiedCamera(width=640, height=480, cx=316.3, cy=243.8, fx=260.0, fy=258.0, xi=0.95)),
])  # fmt: skip
def test_a_camera_through_pictures_of_boards_and_back(name, camera):
    """To 0.05 px rms, wherever corners were seen."""
    R, t = many_poses(BOARD, 20)
    found = [find_corners(picture(camera, *pose, samples=5), BOARD) for pose in zip(R, t, strict=True)]
    pixels = np.array([corners for corners in found if corners is not None])
    assert len(pixels) >= 18
    names = tuple(str(i) for i in range(len(pixels)))
    result = calibrate(Corners(BOARD, 640, 480, names, pixels), [MODELS[name]], rim_px=240.0)
    assert np.sqrt((apart_px(result.camera, camera, max(result.uncertainty_px)) ** 2).mean()) < 0.05


# ------------------------------------------------------------------------------------------------------ tables of corners
def test_corners_written_are_read_again(tmp_path):
    corners = exact(CAMERA, BOARD, *many_poses(BOARD, 3))
    hidden = np.zeros(corners.seen.shape, bool)
    hidden[1, :5] = True
    write_corners(tmp_path / "corners.csv", corners.without(hidden))
    again = read_corners(tmp_path / "corners.csv", BOARD, 640, 480)
    assert again.names == corners.names
    assert np.array_equal(again.pixels, corners.without(hidden).pixels, equal_nan=True)


@pytest.mark.parametrize(("lines", "sentence"), [
    (["image,row,u,v", "a,0,1,2"], "has no column column; its first line should be image,row,column,u,v"),
    (["a,0,8,1,2"], "line 2: row 0, column 8 is not on a board of 6x8 inner corners"),
    (["a,0,0,1000,2"], r"line 2: the corner at \(1000, 2\) lies outside pictures of 640 x 480"),
    (["a,0,0,nan,2"], "line 2: u is nan; write a finite number, and leave out corners that are not seen"),
    (["a,0.5,0,1,2"], "line 2: row is 0.5; write a whole number, counted from 0"),
    (["a,0,0,1,2", "a,0,0,1,2"], "line 3: row 0, column 0 of a was there before"),
    (["a,0,0,1,2"], "has 1 of the 48 corners of a; give half of them or more"),
    (["a,0,0,1"], "line 2: v is None; write a finite number"),
])  # fmt: skip
def test_tables_that_are_wrong(tmp_path, lines, sentence):
    header = [] if lines[0].startswith("image") else ["image,row,column,u,v"]
    (tmp_path / "corners.csv").write_text("\n".join([*header, *lines]) + "\n")
    with pytest.raises(DataError, match=sentence):
        read_corners(tmp_path / "corners.csv", BOARD, 640, 480)
