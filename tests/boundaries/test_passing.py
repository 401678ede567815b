"""Inputs of components are read-only, and what they return is the caller's own, without needless copies."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from omnilab.api import Circle, Estimates, Frames, GridPoses, Match, Places, Plan, PoseGraph, Signatures
from omnilab.cameras import ImageCircle
from omnilab.errors import PluginError
from omnilab.runner.boundaries import guard, read_only
from omnilab.runner.boundaries.passing import unshared

TITLE = "the component"
IMAGES = np.zeros((3, 8, 8), np.uint8)
SIGNATURES = Signatures(np.zeros((3, 4), np.float32), np.zeros((3, 5), np.float32))
PLACES = Places(SIGNATURES, np.tile(np.eye(4), (3, 1, 1)), ["a", "b", "c"], {"basis": np.zeros(2)})
CAMERA = ImageCircle(8, 8, Circle(3.5, 3.5, 4))
PLAN = Plan(["a", "b", "c"], np.tile(np.eye(4), (3, 1, 1)))
FRAMES = Frames(IMAGES, ["a", "b", "c"], np.arange(3), CAMERA, np.arange(3), PLAN.T_world_camera)
EDGES = np.array([[0, 1], [1, 2]])
GRAPH = PoseGraph(np.arange(3), np.zeros((3, 3)), EDGES, np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)))
ZEROS, SQUARE = np.zeros(3), np.eye(3)
ANGLES, SPREADS = np.zeros((1, 2)), np.eye(2)[None]


class Writes:
    """Writes into one of its inputs, wherever it is given any."""

    def __init__(self, write):
        self.write = write

    def _do(self, *values, **more):
        self.write(*values, **more)

    describe = fit = apply = relative = plan = extract = locate = track = match = embed = restore = _do
    query = optimize = add = predict = observe = know_view = _do

    def prepare(self, *values):
        self._do(*values)

    def begin(self, *values):
        self._do(*values)

    def frames(self, plan):
        self._do(plan)
        yield


def _first(array):
    array[..., 0] = 1


@pytest.mark.parametrize(
    ("kind", "method", "values", "write"),
    [
        ("descriptor", "describe", (IMAGES,), _first),
        ("descriptor", "describe", (IMAGES,), lambda images: cv2.circle(images[0], (4, 4), 2, 255)),
        ("descriptor", "describe", (IMAGES,), lambda images: np.add(images, 1, out=images)),
        ("descriptor", "describe", (IMAGES,), lambda images: images.sort()),
        ("descriptor", "describe", (IMAGES,), lambda images: _first(images.reshape(-1)[3:])),
        ("descriptor", "fit", (IMAGES,), _first),
        ("descriptor", "restore", ({"basis": ZEROS},), lambda state: _first(state["basis"])),
        ("disturbance", "apply", (IMAGES, CAMERA, []), lambda images, *_: _first(images)),
        ("distance", "prepare", (SIGNATURES,), lambda places: _first(places.place)),
        ("distance", "match", (SIGNATURES, None), lambda queries, _: _first(queries.heading)),
        ("localizer", "prepare", (PLACES, None), lambda places, _: _first(places.T_world_camera)),
        ("localizer", "prepare", (PLACES, None), lambda places, _: _first(places.signatures.place)),
        ("localizer", "prepare", (PLACES, None), lambda places, _: _first(places.descriptor_state["basis"])),
        ("localizer", "locate", (SIGNATURES, None), lambda queries, _: _first(queries.place)),
        ("localizer", "track", (SIGNATURES, None, SQUARE), lambda queries, _, motion: _first(motion)),
        ("localizer", "embed", (SQUARE[None], None), lambda distance, _: _first(distance)),
        ("altimeter", "relative", (IMAGES, IMAGES, CAMERA), lambda references, *_: _first(references)),
        ("odometry", "extract", (FRAMES,), lambda frames: _first(frames.stamps_ns)),
        ("place_database", "query", (FRAMES, None, 1.0, None), lambda frames, *_: _first(frames.images)),
        ("backend", "begin", (ZEROS,), _first),
        ("backend", "optimize", (GRAPH,), lambda graph: _first(graph.information)),
        ("incremental_graph", "add", (ZEROS, EDGES, SQUARE, SQUARE), lambda pose, edges, *_: _first(edges)),
        ("view_filter", "begin", (ZEROS, SQUARE), lambda pose, _: _first(pose)),
        ("view_map", "predict", (ZEROS, SQUARE), lambda motion, covariance: _first(covariance)),
        ("view_map", "observe", (EDGES[0], ANGLES, SPREADS), lambda views, angles, _: _first(angles)),
        ("view_map", "know_view", (ZEROS, SQUARE), lambda pose, _: _first(pose)),
        ("sensor", "plan", (GridPoses(extent_m=(1.0, 1.0)),), lambda _: None),  # which holds no arrays
    ],
)
def test_inputs_are_read_only(kind, method, values, write):
    component = guard(Writes(write), kind, TITLE)
    wanted = (
        f"^the component: {method} writes into its input .*; copy it first" if "plan" not in method else "returns None"
    )
    with pytest.raises(PluginError, match=wanted):
        getattr(component, method)(*values)
    assert not any(map(np.any, (IMAGES, SIGNATURES.place, SIGNATURES.heading, ZEROS, ANGLES)))


def test_a_sensor_does_not_write_into_its_plan():
    sensor = guard(Writes(lambda plan: _first(plan.T_world_camera)), "sensor", TITLE)
    with pytest.raises(PluginError, match="frames writes into its input `plan`"):
        list(sensor.frames(PLAN))


def test_lists_and_dictionaries_that_are_given_are_copies():
    given = {"keys": ["a", "b"], "more": ([1], {"deep": np.zeros(2)})}
    seen = read_only(given)
    seen["keys"].clear()
    seen["more"][0].append(2)
    seen["more"][1].clear()
    assert given["keys"] == ["a", "b"]
    assert given["more"][0] == [1]
    assert list(given["more"][1]) == ["deep"]


def test_what_is_read_only_stays_what_it_is():
    array = np.zeros(3)
    seen = read_only(PLACES)
    assert seen.signatures.place.base is PLACES.signatures.place
    assert PLACES.signatures.place.flags.writeable
    assert read_only(read_only(array).view()).flags.writeable is False
    assert read_only(CAMERA) is CAMERA
    with pytest.raises(ValueError, match="read-only"):
        seen.T_world_camera[0] = 0


# ------------------------------------------------------------------------------------------------------------- results
class Keeps:
    """Holds on to what it returns, in one way or another, and overwrites it when it is called again."""

    def __init__(self, way):
        self.way, self.number, self.kept = way, 0, None
        self.buffer = np.zeros((9, 4), np.float32)

    def describe(self, images):
        self.number += 1
        self.buffer[:] = self.number
        place = self.buffer[: len(images)]
        match self.way:
            case "its buffer":
                place = self.buffer if len(images) == 9 else place
            case "a view of a view":
                place = self.buffer[1:][: len(images)].reshape(len(images), 2, 2)
            case "a memoryview":
                place = np.asarray(memoryview(self.buffer))[: len(images)]
            case "its signatures":
                self.kept = self.kept or Signatures(place.copy())
                self.kept.place[:] = self.number
                return self.kept
            case "a field":
                return Signatures(np.full((len(images), 2), self.number, np.float32), place)
            case "what no one can write into":
                place = np.broadcast_to(np.float32(self.number), (len(images), 4))
        return Signatures(place)


WAYS = ["a part", "a view of a view", "a memoryview", "its signatures", "a field", "what no one can write into"]


@pytest.mark.parametrize(("way", "count"), [*((way, 3) for way in WAYS), ("its buffer", 9)])
def test_earlier_results_stay_as_they_were(way, count):
    descriptor = guard(Keeps(way), "descriptor", TITLE)
    images = np.zeros((count, 8, 8), np.uint8)
    first, second = descriptor.describe(images), descriptor.describe(images)
    for number, found in ((1, first), (2, second)):
        assert np.all(found.place == number)
        assert found.heading is None or np.all(found.heading == number)
        found.place[:] = 7  # it is the caller's own
    assert np.all(descriptor.describe(images).place == 3)


def test_frames_in_one_buffer_are_frames_of_their_own():
    class Camera:
        """Reads into one buffer."""

        def frames(self, plan):
            images, keys = np.zeros((1, 8, 8), np.uint8), [""]
            for i, key in enumerate(plan.keys):
                images[:], keys[0] = i, key
                yield Frames(images, keys, np.array([i]), CAMERA, np.array([i]), plan.T_world_camera[i : i + 1])

    batches = list(guard(Camera(), "sensor", TITLE).frames(PLAN))
    assert [int(batch.images.max()) for batch in batches] == [0, 1, 2]
    assert [batch.keys for batch in batches] == [["a"], ["b"], ["c"]]


def test_an_index_is_its_makers_own():
    class Own:
        """Writes into what it prepared."""

        def prepare(self, places, *_):
            return {"seen": [], "place": places.place.copy()}

        def match(self, queries, index):
            index["seen"].append(len(queries))
            index["place"][:] = 1
            return Match(np.full((len(queries), 3), len(index["seen"]), np.float32))

        def locate(self, queries, index):
            index["seen"].append(len(queries))
            count = np.full(len(queries), float(len(index["seen"])))
            return Estimates(np.zeros(len(queries), int), count, np.zeros((len(queries), 3)))

    distance = guard(Own(), "distance", TITLE)
    index = distance.prepare(SIGNATURES)
    distance.match(SIGNATURES, index)
    assert distance.match(SIGNATURES, index=index).distance[0, 0] == 2
    localizer = guard(Own(), "localizer", TITLE)
    index = localizer.prepare(SIGNATURES, distance)
    localizer.locate(SIGNATURES, index)
    assert localizer.locate(SIGNATURES, index).distance[0] == 2


def test_what_is_made_anew_is_not_copied():
    def signatures():
        place = np.zeros((3, 8), np.float32)
        return Signatures(place[1:].reshape(2, 2, 4), place * 2)

    def mapped():
        return Places(signatures(), np.zeros((2, 4, 4)), ["a", "b"], {"basis": np.zeros(3)})

    address = []

    def noted(make):
        made = make()
        address.append(made.place.ctypes.data if isinstance(made, Signatures) else made.signatures.place.ctypes.data)
        return made

    for _ in range(20):  # also once the interpreter has warmed up
        assert unshared([noted(signatures)]).place.ctypes.data == address[-1]
        assert unshared([noted(mapped)]).signatures.place.ctypes.data == address[-1]
    held = signatures()
    assert unshared([held]).place.ctypes.data != held.place.ctypes.data
