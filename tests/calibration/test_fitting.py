"""Cameras fitted to corners whose truth is known: exact ones to the last digits, noisy ones as the covariance says."""

from dataclasses import replace

import numpy as np
import pytest
from rendered_boards import apart_px, exact, many_poses

from omnilab.cameras import KannalaBrandtCamera, OCamCamera, UnifiedCamera
from omnilab.cameras.calibration import MODELS, Board, board_poses, calibrate, shown_corners
from omnilab.cameras.calibration.board import front_side
from omnilab.cameras.calibration.start import linear_poses
from omnilab.errors import ConfigError, DataError

BOARD = Board(6, 8, 0.03)
SIZE = {"width": 640, "height": 480}
CAMERAS = {
    "kannala_brandt": KannalaBrandtCamera(
        **SIZE, cx=325.3, cy=236.8, fx=170.0, fy=171.0, k1=-0.02, k2=0.004, k3=-0.002, k4=3e-4
    ),
    "unified": UnifiedCamera(**SIZE, cx=316.3, cy=243.8, fx=260.0, fy=258.0, xi=0.95),
    "ocam": OCamCamera(**SIZE, cx=325.3, cy=236.8, polynomial=(-150.0, 0, 2.4e-3, -2e-6, 1.1e-8), c=1.002, d=8e-4),
}
REACH = {"rim_px": 240.0}


def boards_of(name, count=10):
    return exact(CAMERAS[name], BOARD, *many_poses(BOARD, count))


def noisy(corners, sigma_px, seed=0):
    noise = np.random.default_rng(seed).normal(0, sigma_px, corners.pixels.shape)
    return replace(corners, pixels=corners.pixels + noise)


@pytest.mark.parametrize("name", CAMERAS)
def test_exact_corners_give_the_very_camera(name):
    found = calibrate(boards_of(name), [MODELS[name]], **REACH)
    truth = CAMERAS[name]
    assert found.chosen.fit.rms_px < 1e-9
    assert np.allclose(MODELS[name].settings(found.camera), MODELS[name].settings(truth), rtol=1e-6, atol=1e-9)
    R, t = many_poses(BOARD)
    assert np.allclose(found.chosen.fit.R, R, atol=1e-7)
    assert np.allclose(found.chosen.fit.t, t, atol=1e-6)


def test_of_several_models_the_one_is_chosen_that_shows_boards_left_out_best():
    corners = noisy(boards_of("kannala_brandt"), 0.05)
    found = calibrate(corners, [MODELS["unified"], MODELS["kannala_brandt"]], **REACH)
    assert found.chosen.fit.model.name == "kannala_brandt"
    unified, chosen = found.candidates
    assert unified.held_out_px > 1.5 * chosen.held_out_px > 1.5 * chosen.fit.rms_px


@pytest.mark.slow
def test_settings_lie_as_far_off_as_the_covariance_says():
    truth = MODELS["unified"].settings(CAMERAS["unified"])
    scores = []
    for seed in range(6):
        found = calibrate(noisy(boards_of("unified"), 0.2, seed), [MODELS["unified"]], **REACH)
        error = MODELS["unified"].settings(found.camera) - truth
        scores.append(error @ np.linalg.solve(found.covariance, error))  # chi square of 5 degrees of freedom
    assert 1.1 < np.mean(scores) < 12  # its mean over 6: 5 +- 1.3
    assert np.sqrt((apart_px(found.camera, CAMERAS["unified"], 60) ** 2).mean()) < 0.2


def test_a_wrong_board_and_a_wrong_corner_are_left_out_and_said():
    corners = noisy(boards_of("unified"), 0.05)
    pixels = corners.pixels.copy()
    pixels[3] = np.roll(pixels[3].reshape(6, 8, 2), 1, axis=0).reshape(-1, 2)  # a row of it counted last
    pixels[6, 17] += [8, -5]
    found = calibrate(replace(corners, pixels=pixels), [MODELS["unified"]], **REACH)
    assert list(found.left_out) == ["board-3.png"]
    assert "is off by" in found.left_out["board-3.png"]
    assert found.wrong_corners == 1
    assert found.chosen.fit.rms_px < 0.08


def test_a_picture_that_is_there_twice_counts_once():
    corners = boards_of("unified", 8)
    twice = corners.at([0, 1, 2, 3, 4, 5, 6, 7, 2])
    twice = replace(twice, names=(*corners.names, "copy.png"))
    found = calibrate(noisy(twice, 0.05), [MODELS["unified"]], **REACH)
    assert found.left_out == {"copy.png": "shows the board where board-2.png does"}


# ------------------------------------------------------------------------------------------------------------- refused
def test_too_few_boards_are_refused():
    with pytest.raises(DataError, match=r"4 board\(s\) of 6x8 corners in 4 picture\(s\) are too few .* take 5 or more"):
        calibrate(boards_of("unified", 4))


@pytest.mark.slow
def test_boards_that_are_all_alike_are_refused():
    """All face the camera in the middle of the picture, at one distance: focal length and distance are one."""
    turns = np.arange(8.0) * 40
    R, t = board_poses(BOARD, np.column_stack([np.full(8, 1.5), turns]), [7] * 8, [(0, 0)] * 8, turns)
    with pytest.raises(
        DataError, match=r"the boards are too much alike: they are tilted by .*known (only to|not at all)"
    ):
        calibrate(noisy(exact(CAMERAS["unified"], BOARD, R, t), 0.3), [MODELS["unified"]], rim_px=100.0)


def test_a_rim_without_corners_is_refused_and_the_way_round_works():
    corners = noisy(boards_of("unified"), 0.05)
    with pytest.raises(DataError, match=r"nothing is known beyond.* give --rim ") as error:
        calibrate(corners, [MODELS["unified"]], rim_px=600.0)
    rim = float(str(error.value).split("--rim ")[1].split()[0])
    assert calibrate(corners, [MODELS["unified"]], rim_px=rim).camera.rim_px == rim


def test_corners_of_no_board_are_refused():
    corners = noisy(boards_of("unified"), 9.0)
    with pytest.raises(
        DataError, match=r"misses the corners by \d+\.\d px rms.*is no calibration|only . of 10 boards fit"
    ):
        calibrate(corners, [MODELS["unified"]], **REACH)


@pytest.mark.parametrize(("board", "square", "sentence"), [
    ("6x7", "30", "has no unit; give 30mm, 30cm or 30m"),
    ("6x7", "30furlong", "is no length; give one such as 30mm"),
    ("6x7", "30m", "squares of 30 m are on no board"),
    ("67", "30mm", "is no board; give its inner corners, rows x columns, such as 6x7"),
    ("6x2", "30mm", "a board of 6x2 inner corners is none"),
])  # fmt: skip
def test_boards_that_are_none(board, square, sentence):
    with pytest.raises(ConfigError, match=sentence):
        Board.of_texts(board, square)


def test_lengths_of_boards():
    assert Board.of_texts("6x7", "30mm") == Board.of_texts(" 6 X 7", "3cm") == Board.of_texts("6×7", "0.03m")
    assert Board.of_texts("6x7", "1.5in").square_m == pytest.approx(0.0381)


# --------------------------------------------------------------------------------------------------------------- parts
def test_poses_are_linear_in_rays_beyond_a_right_angle_too():
    directions = [(20, 10), (80, 120), (100, 240)]
    R, t = board_poses(BOARD, directions, [7, 8, 9], [(20, 10), (-30, 5), (10, -25)], [0, 50, 130])
    rays = BOARD.points @ np.swapaxes(R, 1, 2) + t[:, None]
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    rays[1, 5] = np.nan  # not seen
    found_R, found_t = linear_poses(rays, BOARD.points)
    assert np.allclose(found_R, R, atol=1e-9)
    assert np.allclose(found_t, t, atol=1e-8)


def test_corners_counted_from_either_side_are_seen_from_the_front():
    R, t = many_poses(BOARD, 1)
    pixels = shown_corners(CAMERAS["unified"], BOARD, R, t)[0]
    other = pixels.reshape(6, 8, 2)[:, ::-1].reshape(-1, 2)
    assert np.array_equal(front_side(other, 6, 8), front_side(pixels, 6, 8))
    assert np.array_equal(front_side(pixels, 6, 8), pixels)
