"""`omnilab world plan`: what is drawn where, in which length, and what is refused."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from omnilab.errors import ConfigError
from omnilab_mirror.commands import world_command
from omnilab_mirror.plan import DARK, LONG_PX, MAP, MARGIN_PX, PLACE, FloorPlan, plan_of
from omnilab_mirror.scene.load import load_world

ROOM = """
map_m: [4, 2]
textures:
  red: {kind: plain, color: [200, 0, 0]}
  grey: {kind: plain, color: [120, 120, 120]}
light: {ambient: 1.0, lamps: []}
objects:
  - {kind: room, size: [5, 4, 3], floor: grey, ceiling: grey, north: grey, south: grey, east: grey, west: grey}
  - {kind: box, at: [1, 0.5], size: [0.8, 0.4, 0.5], texture: red}
"""


@pytest.fixture
def world(tmp_path):
    (tmp_path / "plain.yaml").write_text(ROOM)
    return str(tmp_path / "plain.yaml")


def test_things_stand_where_they_are_and_lengths_are_to_scale(world):
    picture = plan_of(load_world(world))
    assert picture.shape[1] == LONG_PX + 2 * MARGIN_PX
    sheet = FloorPlan(np.array([-2.5, -2.0]), np.array([2.5, 2.0]), LONG_PX / 5)
    column, row = np.round(sheet.pixels(np.array([[1.0, 0.5]]))[0]).astype(int)
    assert picture[row, column, 0] > 1.5 * picture[row, column, 1]  # red
    red = (picture[..., 0].astype(int) > 1.5 * picture[..., 1]) & (picture[..., 1] == picture[..., 2])
    rows, columns = np.nonzero(red)
    assert np.ptp(columns) / sheet.px_per_m == pytest.approx(0.8, abs=0.03)
    assert np.ptp(rows) / sheet.px_per_m == pytest.approx(0.4, abs=0.03)
    for half, color in (((2.0, 1.0), MAP), ((2.5, 2.0), DARK)):
        corner = np.round(sheet.pixels(np.array([half]))[0]).astype(int)
        assert tuple(picture[corner[1], corner[0]]) == color


def test_dots_are_the_free_places(world):
    without, dotted = plan_of(load_world(world)), plan_of(load_world(world), step_m=0.5)
    dots = np.all(dotted == PLACE, axis=-1) & ~np.all(without == PLACE, axis=-1)
    count, _ = cv2.connectedComponents(dots.astype(np.uint8))
    assert count - 1 == 9 * 5 - 1  # nodes of 4 x 2 m, less the one in the box


def test_the_command_writes_a_png(world, tmp_path, capsys):
    assert world_command(["plan", world, str(tmp_path / "plan.png"), "--pixels", "50"]) == 0
    picture = cv2.imread(str(tmp_path / "plan.png"))
    assert picture.shape == (4 * 50 + 2 * MARGIN_PX, 5 * 50 + 2 * MARGIN_PX, 3)
    assert "470 x 420 pixels" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["plan.jpg"], "no name of a PNG"),
        (["plan.png", "--step", "0"], "--step 0 makes no grid"),
        (["plan.png", "--step", "nan"], "--step nan makes no grid"),
        (["plan.png", "--step", "1e-9"], "give a step such as"),
        (["plan.png", "--pixels", "0"], "--pixels 0 is out of range"),
        (["plan.png", "--pixels", "nan"], "--pixels nan is out of range"),
        (["plan.png", "--pixels", "1e6"], "give at most"),
        (["gone/plan.png"], "a folder that is there"),
    ],
)
def test_plans_that_cannot_be_drawn_are_refused(world, tmp_path, arguments, words):
    picture, *others = arguments
    with pytest.raises(ConfigError, match=words):
        world_command(["plan", world, str(tmp_path / picture), *others])
