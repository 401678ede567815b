"""What components return is checked where it passes to the study: one sentence names plugin, component and item."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from omnilab.api import (
    Circle,
    Embedding,
    Estimates,
    Frames,
    Heights,
    Match,
    Mesh,
    Metric,
    Places,
    Plan,
    Report,
    Signatures,
)
from omnilab.cameras import EquirectangularCamera, ImageCircle
from omnilab.errors import PluginError
from omnilab.geometry import planar_poses
from omnilab.runner.boundaries import check_declared, check_report, guard

TITLE = "the component"
CAMERA = ImageCircle(8, 8, Circle(3.5, 3.5, 4))
IMAGES = np.zeros((5, 8, 8), np.uint8)
QUERIES = Signatures(np.arange(12, dtype=np.float32).reshape(3, 4))
PLACES = Places(
    Signatures(np.arange(16, dtype=np.float32).reshape(4, 4)), planar_poses(np.eye(4)[:, :3]), ["a", "b", "c", "d"]
)
EVERY = np.arange(3)


@dataclass
class Says:
    """A component of any kind that returns what it was made with."""

    answer: object = None

    def _answer(self, *values, **more):
        return self.answer(*values, **more) if callable(self.answer) else self.answer

    describe = match = locate = track = embed = apply = relative = extract = estimate = optimize = plan = _answer
    scene = fit = restore = state = query = add = pose = poses = _answer

    def prepare(self, places, *others):
        return (places, *others)

    def begin(self, *values):
        return self._answer(*values)

    def frames(self, plan):
        yield from self._answer(plan)


def says(kind, answer):
    return guard(Says(answer), kind, TITLE)


def wrong(call, *expected):
    """The sentence with which a call is refused."""
    with pytest.raises(PluginError) as refused:
        call()
    sentence = str(refused.value)
    assert sentence.startswith(f"{TITLE}: "), sentence
    assert "\n" not in sentence
    for part in expected:
        assert part in sentence, sentence
    return refused.value


# -------------------------------------------------------------------------------------------------------- descriptors
def place(change=lambda place: place, heading=None):
    """Signatures of ones, changed."""
    return lambda images: Signatures(change(np.ones((len(images), 2, 4), np.float32)), heading)


def with_nan(array, at=2, value=np.nan):
    array[at, ..., 0] = value
    return array


@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (None, "returns None, not Signatures"),
        (lambda images: images.astype(np.float32), "an array of float32 (5, 8, 8), not Signatures"),
        (place(lambda p: p.astype(float)), "`place` of type float64, not float32"),
        (place(lambda p: p.astype(int)), "`place` of type int64, not float"),
        (place(lambda p: p[:3]), "`place` of shape (3, 2, 4), not (5, ...)"),
        (place(lambda p: p[:, :0]), "(5, 0, 4), which holds no numbers per image"),
        (place(lambda p: p[:, 0, 0]), "(5,), which holds no numbers per image"),
        (place(lambda p: p.tolist()), "`place` as list, not as an array"),
        (place(lambda p: None), "`place` as None, not as an array"),
        (place(heading=np.ones((4, 6), np.float32)), "`heading` of shape (4, 6), not (5, ...)"),
        (place(with_nan), "NaN or infinity in `place` (5 % of all numbers, in 1 of 5 images, the first is number 2)"),
        (place(lambda p: with_nan(p, slice(None), np.inf)), "(25 % of all numbers, in 5 of 5 images"),
        (place(lambda p: with_nan(p, 4, -np.inf)), "the first is number 4"),
        (place(heading=np.full((5, 6), np.nan, np.float32)), "NaN or infinity in `heading` (100 %"),
    ],
)
def test_signatures(answer, expected):
    error = wrong(lambda: says("descriptor", answer).describe(IMAGES), "describe returns", expected, "check_descriptor")
    assert (error.item is not None) == ("first is number" in str(error))


def test_signatures_of_images_of_one_size_have_one_shape():
    descriptor = says("descriptor", lambda images: Signatures(np.ones((len(images), 7 - len(images)), np.float32)))
    descriptor.describe(IMAGES)
    wrong(lambda: descriptor.describe(IMAGES[:2]), "shape (5,) an image, and (2,) of images of the same size before")
    assert descriptor.describe(np.zeros((3, 9, 9), np.uint8)).place.shape == (3, 4)  # of other images, another


def test_another_setting_may_have_another_shape():
    @dataclass
    class Sized:
        """Of any size."""

        size: int = 2

        def describe(self, images):
            return Signatures(np.ones((len(images), self.size), np.float32))

    first = guard(Sized(), "descriptor", TITLE)
    first.describe(IMAGES)
    assert replace(first, size=3).describe(IMAGES).place.shape == (5, 3)


def test_what_was_trained_is_checked_too():
    class Fitted(Says):
        """Trained."""

    trainable = says("descriptor", lambda *_: Fitted(lambda images: None))
    assert isinstance(trainable.fit(IMAGES), Fitted)
    wrong(lambda: trainable.fit(IMAGES).describe(IMAGES), "describe returns None")
    wrong(lambda: trainable.restore({}).describe(IMAGES), "describe returns None")
    wrong(lambda: says("descriptor", 5).fit(IMAGES), "fit returns int, which has no describe and no state")
    wrong(says("descriptor", lambda: {"a": np.array([np.nan])}).state, "state returns NaN or infinity in `a`")
    wrong(says("descriptor", lambda: {"a": np.array([np.nan * 1j])}).state, "state returns NaN or infinity in `a`")
    assert "a" in says("descriptor", lambda: {"a": np.array([1j], np.complex64)}).state()  # of spectra


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("rotation", "spins", "rotation='spins', which is none of equivariant, invariant, none"),
        ("rotation", None, "rotation=None"),
        ("view", "cube", "view='cube', which is none of mirror, panorama, sphere"),
        ("color", "no", "color='no', which is neither True nor False"),
    ],
)
def test_declarations(name, value, expected):
    class Declared:
        view, rotation, color = "mirror", "none", False

    check_declared("descriptor", Declared(), TITLE)
    setattr(Declared, name, value)
    with pytest.raises(PluginError, match="the component declares ") as refused:
        check_declared("descriptor", Declared(), TITLE)
    assert expected in str(refused.value)


# -------------------------------------------------------------------------------------------- distances and localizers
ZEROS = np.zeros((3, 4), np.float32)


@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (None, "returns None, not Match"),
        (Match(ZEROS.T), "`distance` of shape (4, 3), not (3, 4)"),
        (Match(ZEROS[:, :3]), "(3, 3), not (3, 4)"),
        (Match(ZEROS[0]), "(4,), not (3, 4)"),
        (Match(ZEROS.astype(int)), "of type int64, not float"),
        (Match(with_nan(ZEROS.copy())), "NaN or infinity in `distance` (8.33 % of all numbers, in 1 of 3 queries"),
        (Match(ZEROS + np.inf), "100 %"),
        (Match(ZEROS, ZEROS[:, 0]), "`rotation_rad` of shape (3,), not (3, 4)"),
        (Match(ZEROS, ZEROS * np.nan), "NaN or infinity in `rotation_rad`"),
    ],
)
def test_matches(answer, expected):
    distance = says("distance", answer)
    index = distance.prepare(PLACES.signatures)
    wrong(lambda: distance.match(QUERIES, index), "match returns", expected, "check_distance")


def estimates(**changed):
    sound = {"place": EVERY, "distance": ZEROS[:, 0], "position_m": ZEROS[:, :3], "heading_rad": None, "field": ZEROS}
    return Estimates(**sound | changed)


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"place": EVERY - 1}, "`place` -1, which is no index of the map's places (from 0 to 3)"),
        ({"place": EVERY + 2}, "`place` 4, which is no index"),
        ({"place": EVERY * 1.0}, "`place` of type float64, not whole"),
        ({"place": EVERY[:2]}, "`place` of shape (2,), not (3,)"),
        ({"distance": ZEROS}, "`distance` of shape (3, 4), not (3,)"),
        ({"position_m": ZEROS[:, :2]}, "`position_m` of shape (3, 2), not (3, 3)"),
        ({"position_m": ZEROS[:, :3] * np.nan}, "NaN or infinity in `position_m`"),
        ({"position_m": ZEROS[:, :3] + np.inf}, "NaN or infinity in `position_m`"),
        ({"heading_rad": EVERY + np.inf}, "infinity in `heading_rad`"),
        ({"heading_rad": ZEROS}, "`heading_rad` of shape (3, 4)"),
        ({"field": ZEROS[:, 1:]}, "`field` of shape (3, 3), not (3, 4)"),
        ({"field": ZEROS * np.nan}, "NaN or infinity in `field`"),
    ],
)
@pytest.mark.parametrize("method", ["locate", "track"])
def test_estimates(changed, expected, method):
    localizer = says("localizer", estimates(**changed))
    index = localizer.prepare(PLACES, says("distance", Match(ZEROS)))
    motion = [np.zeros((3, 3))] if method == "track" else []
    wrong(lambda: getattr(localizer, method)(QUERIES, index, *motion), f"{method} returns", expected, "check_localizer")


def test_headings_that_are_not_known_are_no_mistake():
    localizer = says("localizer", estimates(heading_rad=EVERY * np.nan))
    assert np.isnan(localizer.locate(QUERIES, localizer.prepare(PLACES, None)).heading_rad).all()


def test_maps_of_embedders():
    def answer(value):
        return lambda *_, **__: Embedding(np.full((1, 4, 2), value), np.zeros(1), np.ones(1, int))

    distance = np.zeros((1, 4, 4))
    assert says("localizer", answer(0.0)).embed(distance, None, steps=3).position.shape == (1, 4, 2)
    wrong(lambda: says("localizer", answer(np.nan)).embed(distance, None), "NaN or infinity in `position`")
    wrong(lambda: says("localizer", None).embed(distance, None), "embed returns None, not Embedding")


# ----------------------------------------------------------------------------------- images, heights, what they come from
@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (None, "images as None, not as an array (5, 8, 8)"),
        (IMAGES[:4], "images of shape (4, 8, 8), not (5, 8, 8)"),
        (IMAGES * np.nan, "images of type float64, not uint8"),
        (IMAGES.astype(np.uint16), "images of type uint16, not uint8"),
    ],
)
def test_disturbed_images(answer, expected):
    wrong(lambda: says("disturbance", answer).apply(IMAGES, CAMERA, []), "apply returns", expected, "check_disturbance")


def heights(**changed):
    sound = {"value": np.zeros(5), "unit": "px", "confidence": np.ones(5), "rotation_rad": np.zeros(5)}
    return Heights(**sound | changed)


@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (None, "returns None, not Heights"),
        (heights(value=np.zeros(4)), "`value` of shape (4,), not (5,)"),
        (heights(value=np.full(5, np.inf)), "infinity in `value`"),
        (heights(confidence=np.full(5, 1.5)), "`confidence` outside of [0, 1]"),
        (heights(rotation_rad=np.full(5, np.nan)), "NaN in `rotation_rad` of images whose height it estimates"),
        (heights(curves={"a": np.zeros((4, 3))}), "curve 'a' of shape (4, 3), not (5, any)"),
    ],
)
def test_heights(answer, expected):
    wrong(lambda: says("altimeter", answer).relative(IMAGES, IMAGES, CAMERA), "relative returns", expected)


def test_no_estimate_of_a_height_is_no_mistake():
    unknown = np.full(5, np.nan)
    answer = heights(value=unknown, confidence=unknown, rotation_rad=unknown)
    assert np.isnan(says("altimeter", answer).relative(IMAGES, IMAGES, CAMERA).value).all()


# ------------------------------------------------------------------------------------------------------------- sensors
POSES = planar_poses(np.zeros((5, 3)))
PLAN = Plan(["a", "b", "c", "d", "e"], POSES)


def frames(**changed):
    sound = {
        "images": IMAGES, "keys": list("abcde"), "stamps_ns": np.arange(5), "camera": CAMERA,
        "plan_index": np.arange(5), "T_world_camera": POSES,
    }  # fmt: skip
    return Frames(**sound | changed)


def poses(**changed):
    """Poses of which number 3 is spoilt."""
    T = POSES.copy()
    for value in changed.values():
        T[3] = value
    return T


@pytest.mark.parametrize(
    ("T", "expected"),
    [
        (poses(a=np.nan), "NaN or infinity in `T_world_camera` (20 % of all numbers, in 1 of 5 frames, the first is number 3)"),
        (poses(a=np.diag([1, 1, -1, 1])), "no rigid motions (1 of 5 frames, the first is number 3)"),
        (poses(a=np.diag([2, 2, 2, 1])), "no rigid motions"),
        (poses(a=np.zeros((4, 4))), "no rigid motions"),
        (np.swapaxes(POSES + np.eye(4)[3] * 2, 1, 2), "no rigid motions"),
        (POSES[:4], "of shape (4, 4, 4), not (5, 4, 4)"),
        (POSES[:, :3], "of shape (5, 3, 4)"),
    ],
)  # fmt: skip
def test_poses_are_rigid_motions(T, expected):
    wrong(lambda: says("sensor", Plan(list("abcde"), T)).plan(None), "plan returns", expected, "check_sensor")
    wrong(lambda: list(says("sensor", [frames(T_world_camera=T)]).frames(PLAN)), "frames returns", expected)


@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (None, "plan returns None, not Plan"),
        (Plan(list("abcd"), POSES), "`T_world_camera` of shape (5, 4, 4), not (4, 4, 4)"),
        (Plan("abcde", POSES), "`keys` as str, not as a sequence of texts"),
        (Plan([1, 2, 3, 4, 5], POSES), "`keys` of which number 0 is int, not a text"),
    ],
)
def test_plans(answer, expected):
    wrong(lambda: says("sensor", answer).plan(None), expected)


@pytest.mark.parametrize(
    ("batches", "expected"),
    [
        ([None], "returns None, not Frames"),
        ([frames(images=IMAGES[:4])], "`images` of shape (4, 8, 8), not (5, any, any, ...)"),
        ([frames(images=IMAGES[..., None])], "not (N, H, W) or (N, H, W, 3)"),
        ([frames(images=IMAGES / 255)], "`images` of type float64, not uint8"),
        ([frames(keys=list("abcd"))], "`images` of shape (5, 8, 8), not (4,"),
        ([frames(plan_index=np.arange(5) + 1)], "`plan_index` 5, which is no index of the plan's frames (from 0 to 4)"),
        ([frames(plan_index=np.arange(5.0))], "`plan_index` of type float64, not whole"),
        ([frames(stamps_ns=np.arange(4))], "`stamps_ns` of shape (4,), not (5,)"),
        ([frames(stamps_ns=np.arange(5) / 3)], "`stamps_ns` of type float64, not int64"),
        ([frames(camera=None)], "`camera` as None, not as a Camera"),
        ([frames(depth_m=np.zeros((5, 4, 4), np.float32))], "`depth_m` of shape (5, 4, 4), not (5, 8, 8)"),
        ([frames().at(0)], "1 of 5 planned frames, and says of 0 why they are missing"),
        ([frames(), frames()], "`plan_index` 0 after 4; frames come in the plan's order, each once"),
    ],
)
def test_frames(batches, expected):
    wrong(lambda: list(says("sensor", batches).frames(PLAN)), "frames returns", expected)


def test_a_panorama_has_no_circle_and_another_camera_has_one():
    panoramas = frames(images=np.zeros((5, 8, 16), np.uint8), camera=EquirectangularCamera(16, 8))
    assert len(list(says("sensor", [panoramas]).frames(PLAN))) == 1
    for circle in (Circle(4, 4, 3, 3), Circle(4, 4, -1), Circle(np.nan, 4, 3), Circle(4, 4, 3, -1)):
        wrong(lambda c=circle: list(says("sensor", [frames(camera=ImageCircle(8, 8, c))]).frames(PLAN)), "circle")


def test_frames_that_are_missing_need_a_reason():
    lost = [f"{key}: torn" for key in "bcde"]
    assert len(list(says("sensor", [replace(frames().at(0), omitted=lost)]).frames(PLAN))) == 1


def test_meshes():
    def mesh(vertices, triangles):
        return Mesh(np.asarray(vertices, float), np.asarray(triangles), np.zeros((3, 3), np.uint8))

    corners = np.eye(3)
    assert says("sensor", mesh(corners, [[0, 1, 2]])).scene() is not None
    assert says("sensor", None).scene() is None
    wrong(says("sensor", mesh(corners * np.nan, [[0, 1, 2]])).scene, "NaN or infinity in `vertices_m`")
    wrong(says("sensor", mesh(corners, [[0, 1, 3]])).scene, "`triangles` 3, which is no index of the vertices")


# ------------------------------------------------------------------------------------------------------------- studies
@pytest.mark.parametrize(
    ("report", "expected"),
    [
        (None, "run returns None, not Report"),
        (Report([("a", 1)]), "run returns tuple, not Metric"),
        (Report([Metric("a", None, "1")]), "metric 'a' as None, not as a number"),
        (Report([Metric("a", "1", "1")]), "metric 'a' as str"),
        (Report([Metric("a", 1, "1"), Metric("a", 2, "1")]), "metric 'a' twice"),
        (Report([], {"rows": {"a": [1, 2], "b": [1]}}), "table 'rows' with columns of different lengths"),
    ],
)
def test_reports(report, expected):
    with pytest.raises(PluginError) as refused:
        check_report(report, TITLE)
    assert expected in str(refused.value)
