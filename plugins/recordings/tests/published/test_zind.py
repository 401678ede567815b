"""Tours of ZInD, made up as the set's own code reads them: poses, rooms and floors, and files that are none."""

import json

import cv2
import numpy as np
import pytest

from omnilab.api import RecordedPoses
from omnilab.errors import DataError
from omnilab_recordings import Folder
from omnilab_recordings.published.conversions import prepare
from omnilab_recordings.published.published_set import published_set

SCALE, PLAN = 2.0, 0.5  # metres of a unit of the floor's plan; units of the floor's in one of a panorama's
POINT = np.array([3.0, -1.0])  # of the floor's plan


def panorama(file, at, rotation, seen=None):
    """A picture with a white column where `seen`, a point of the floor's plan, is: by the set's own equations."""
    picture = np.full((16, 32), 9, np.uint8)
    if seen is not None:
        angle = np.radians(rotation)
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        x, y = (seen - at) @ turn.T / PLAN  # Transformation2D.apply_inverse
        theta = np.arctan2(-x, y)  # TransformationSpherical.cartesian_to_sphere
        picture[:, round(32 * (theta + np.pi) / (2 * np.pi) - 0.5) % 32] = 255
    file.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(file), picture)
    transformation = {"translation": list(at), "rotation": rotation, "scale": PLAN}
    return {"image_path": f"panos/{file.name}", "camera_height": 1.2, "floor_plan_transformation": transformation}


@pytest.fixture
def tour(tmp_path):
    """Two floors: one room of two parts and a closet below, a room without a scale above."""
    at = {
        "floor_01_partial_room_02_pano_2": ([1.0, 2.0], 0.0),
        "floor_01_partial_room_01_pano_10": ([0.5, -2.5], -150.0),
    }
    at["floor_01_partial_room_03_pano_3"] = ([4.0, 1.0], 75.0)
    made = {
        name: panorama(tmp_path / f"tour/panos/{name}.jpg", np.array(where), turn, POINT)
        for name, (where, turn) in at.items()
    }
    parts = {name[9:24]: {name[25:]: known} for name, known in made.items()}
    closet = parts.pop("partial_room_03")
    above = panorama(tmp_path / "tour/panos/floor_02_partial_room_04_pano_4.jpg", np.zeros(2), 0.0)
    merger = {
        "floor_01": {"complete_room_01": parts, "complete_room_02": {"partial_room_03": closet}},
        "floor_02": {"complete_room_03": {"partial_room_04": {"pano_4": above}}},
    }
    write(tmp_path, {"merger": merger, "scale_meters_per_coordinate": {"floor_01": SCALE, "floor_02": None}})
    return tmp_path / "tour"


def write(folder, whole):
    (folder / "tour/zind_data.json").write_text(whole if isinstance(whole, str) else json.dumps(whole))


def test_poses_are_those_that_the_pictures_show(tour, tmp_path):
    """The point that each picture marks lies, by the written poses, where the plan has it: its y is negated, once for all."""
    lines = prepare(published_set("zind"), tour, tmp_path / "out")
    assert "floor_01: 3 images, 3 of them with positions" in lines[0]
    assert lines[1] == f"{tmp_path}/out/floor_02: left out, as its plan has no scale in metres"
    assert not (tmp_path / "out/floor_02").exists()
    sensor = Folder(str(tmp_path / "out/floor_01"), panorama="equirectangular")
    plan = sensor.plan(RecordedPoses())
    assert list(plan.keys) == [
        "images/complete_room_01/floor_01_partial_room_01_pano_10.jpg",
        "images/complete_room_01/floor_01_partial_room_02_pano_2.jpg",
        "images/complete_room_02/floor_01_partial_room_03_pano_3.jpg",
    ]
    np.testing.assert_allclose(plan.T_world_camera[:, :3, 3], [[1, 5, 1.2], [2, -4, 1.2], [8, -2, 1.2]], atol=1e-6)
    point_m = SCALE * POINT * [1, -1]
    for frames in sensor.frames(plan):
        for image, T in zip(frames.images, frames.T_world_camera, strict=True):
            x, y = (point_m - T[:2, 3]) @ T[:2, :2]
            column = frames.camera.pixels(np.array([x, y, 0.0]))[0]
            assert abs((image[8].argmax() - column + 16) % 32 - 16) < 1


@pytest.mark.parametrize(
    ("where", "value", "sentence"),
    [
        (["scale_meters_per_coordinate", "floor_01"], None, r"says of no floor how many metres its plan has \(scale_met"),
        (["scale_meters_per_coordinate", "floor_01"], "2", "has '2' where scale_meters_per_coordinate of floor_01 is due"),
        (["scale_meters_per_coordinate"], 3, "has no scale_meters_per_coordinate for the tour; is it the zind_data.json"),
        (["merger"], None, "has no merger for the tour"),
        (["merger", "floor_01", "complete_room_01"], [], "holds no rooms and panoramas in complete_room_01"),
        (["merger", "../floor"], {}, "has '../floor' where floor_01 or complete_room_01 is due"),
        (["pano", "image_path"], "panos/gone.jpg", r"zind_data.json names .*panos/gone.jpg, which is not there; complete"),
        (["pano", "image_path"], "../a.jpg", "names no image below its folder for partial_room_02, pano_2"),
        (["pano", "floor_plan_transformation", "translation"], [1], "has no translation of two numbers for partial_room"),
        (["pano", "floor_plan_transformation", "rotation"], float("nan"), "has nan where rotation of partial_room_02, pano_2"),
        (["pano", "camera_height"], True, "has True where camera_height of partial_room_02, pano_2 is due"),
    ],
)  # fmt: skip
def test_what_is_no_tour_is_one_sentence(tour, tmp_path, where, value, sentence):
    whole = json.loads((tour / "zind_data.json").read_text())
    if where[0] == "pano":
        where = ["merger", "floor_01", "complete_room_01", "partial_room_02", "pano_2", *where[1:]]
    inner = whole
    for key in where[:-1]:
        inner = inner[key]
    inner[where[-1]] = value
    write(tmp_path, whole)
    with pytest.raises(DataError, match=sentence):
        prepare(published_set("zind"), tour, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "sentence"), [("{", "is no JSON"), ("[1]", "is no tour"), ("[" * 99999, "is no JSON")]
)
def test_what_is_no_json_is_one_sentence(tour, tmp_path, text, sentence):
    write(tmp_path, text)
    with pytest.raises(DataError, match=sentence):
        prepare(published_set("zind"), tour, tmp_path / "out")
