"""Every result of every kind of component, spoilt in every way: a sentence that names the component, or no harm."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest
from spoiling import each_is_a_sentence, harmless, parts

from omnilab.api import (
    KINDS,
    Circle,
    Closures,
    Embedding,
    Estimates,
    Frames,
    Heights,
    ImageFeatures,
    Match,
    Mesh,
    Motion,
    Optimized,
    Plan,
    PoseGraph,
    Signatures,
)
from omnilab.cameras import ImageCircle
from omnilab.geometry import planar_poses
from omnilab.runner.boundaries import guard
from omnilab.runner.boundaries.returns import BEGUN, CHECKS

TITLE = "the component"
IMAGES = np.arange(3 * 8 * 8, dtype=np.uint8).reshape(3, 8, 8)
CAMERA = ImageCircle(8, 8, Circle(3.5, 3.5, 4))
POSES = planar_poses(np.arange(9.0).reshape(3, 3), np.arange(3.0))
PLAN = Plan(["a", "b", "c"], POSES)
FRAMES = Frames(IMAGES, ["a", "b", "c"], np.arange(3), CAMERA, np.arange(3), POSES, (), np.ones((3, 8, 8), np.float32))
SIGNATURES = Signatures(np.ones((3, 2, 4), np.float32), np.ones((3, 5), np.float32))
EDGES = np.array([[0, 1], [1, 2]])
PLANAR = PoseGraph(np.arange(3), np.ones((3, 3)), EDGES, np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)))
TURNED = np.tile([1.0, 2, 3, 0, 0, 0, 1], (3, 1))
SPATIAL = PoseGraph(np.arange(3), TURNED, EDGES, TURNED[:2], np.tile(np.eye(6), (2, 1, 1)))
CURVES = {"distance": np.ones((3, 7))}


class Says:
    """A component of any kind that returns what it is told."""

    def __init__(self, answer: Any) -> None:
        self.answer = answer

    def say(self, *_: Any, **__: Any) -> Any:
        return self.answer

    describe = match = locate = track = embed = apply = relative = extract = estimate = optimize = plan = scene = say
    state = query = add = pose = poses = predict = observe = add_view = know_view = views = view_covariances = say
    finish = say

    def prepare(self, *_: Any) -> None: ...

    def frames(self, _: Plan) -> Iterator[Any]:
        yield self.answer


class Begins:
    """A component of a kind that begins something, which returns what it is told."""

    def __init__(self, answer: Any) -> None:
        self.answer = answer

    def begin(self, *_: Any) -> Says:
        return Says(self.answer)


class Attacked(NamedTuple):
    """A method that is attacked: what it may return, and how it is called."""

    kind: str
    method: str
    sound: Any
    call: Callable[[Any], Any]


def _optimum(graph: PoseGraph) -> Optimized:
    d = graph.information.shape[-1]
    spreads = np.tile(np.eye(d), (len(graph), 1, 1))
    edges = np.ones(len(graph.edges))
    return Optimized(graph.poses, 2.0, 1.0, 3, edges, spreads, ["sad"], ["glad"], edges > 0, {"given": 1.0})


def _localized(method: str, *more: Any) -> Callable[[Any], Any]:
    return lambda localizer: getattr(localizer, method)(SIGNATURES, localizer.prepare(SIGNATURES, None), *more)


def _known(count: int) -> Callable[[Any], None]:
    """Has a map of views count so many."""

    def fill(view_map: Any) -> None:
        answer, view_map.answer = view_map.answer, 0
        for view_map.answer in range(count):
            view_map.add_view()
        view_map.answer = []
        for _ in range(count):
            view_map.predict(np.zeros(3), np.eye(3))
        view_map.answer = answer

    return fill


def _viewed(method: str, count: int = 2) -> Callable[[Any], Any]:
    def call(view_map: Any) -> Any:
        _known(count)(view_map)
        return getattr(view_map, method)()

    return call


def _queried(database: Any) -> Any:
    answer = database.answer
    database.answer = Closures(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0), 0)
    for _ in range(4):
        database.query(FRAMES.at(0), None, 1.0, None)
    database.answer = answer
    return database.query(FRAMES.at(0), None, 1.0, None)


def _grown(graph: Any) -> Any:
    answer, graph.answer = graph.answer, []
    for _ in range(2):
        graph.add(np.zeros(3), EDGES, np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)))
    graph.answer = answer
    return graph.poses()


FIELD = np.ones((3, 3), np.float32)
ROTATIONS = np.tile(np.eye(3), (*FIELD.shape, 1, 1))
FEATURES = ImageFeatures(np.eye(3, dtype=np.float32), np.zeros((3, 2), np.float32), np.ones((3, 8), np.uint8))
ATTACKED = [
    Attacked("sensor", "plan", PLAN, lambda sensor: sensor.plan(None)),
    Attacked("sensor", "frames", FRAMES, lambda sensor: next(iter(list(sensor.frames(PLAN))))),
    Attacked("sensor", "scene", Mesh(np.eye(4)[:, :3], np.array([[0, 1, 3]]), np.zeros((4, 3), np.uint8)),
             lambda sensor: sensor.scene()),
    Attacked("disturbance", "apply", IMAGES, lambda disturbance: disturbance.apply(IMAGES, CAMERA, [None] * 3)),
    Attacked("descriptor", "describe", SIGNATURES, lambda descriptor: descriptor.describe(IMAGES)),
    Attacked("descriptor", "state", {"basis": np.eye(3)}, lambda descriptor: descriptor.state()),
    Attacked("distance", "match", Match(FIELD, FIELD, ROTATIONS), _localized("match")),
    Attacked("localizer", "locate", Estimates(np.arange(3), FIELD[0], POSES[:, :3, 3], FIELD[0], FIELD), _localized("locate")),
    Attacked("localizer", "track", Estimates(np.arange(3), FIELD[0], POSES[:, :3, 3]), _localized("track", POSES[:, :3, 3])),
    Attacked("localizer", "embed", Embedding(np.zeros((1, 3, 2)), np.zeros(1), np.ones(1, int), np.zeros((4, 1, 3, 2))),
             lambda embedder: embedder.embed(FIELD[None], None, steps=4)),
    Attacked("altimeter", "relative", Heights(FIELD[0], "px", FIELD[0], FIELD[0], CURVES),
             lambda altimeter: altimeter.relative(IMAGES, IMAGES, CAMERA)),
    Attacked("odometry", "extract", [FEATURES] * 3, lambda odometry: odometry.extract(FRAMES)),
    Attacked("odometry", "estimate", Motion(np.ones(3), np.eye(3), "m", "", np.zeros((4, 2, 2)), np.ones(4, bool), 9, 0.5),
             lambda odometry: odometry.estimate(None, None, None)),
    Attacked("place_database", "query", Closures(np.array([0, 2]), np.ones((2, 3)), np.tile(np.eye(3), (2, 1, 1)), np.ones(2), 3),
             _queried),
    Attacked("backend", "optimize", _optimum(PLANAR), lambda backend: backend.optimize(PLANAR)),
    Attacked("backend", "optimize", _optimum(SPATIAL), lambda backend: backend.optimize(SPATIAL)),
    Attacked("incremental_graph", "add", ["a warning"], lambda graph: graph.add(np.zeros(3), EDGES, None, None)),
    Attacked("incremental_graph", "pose", np.ones(3), lambda graph: graph.pose(0)),
    Attacked("incremental_graph", "poses", np.ones((3, 3)), _grown),
    Attacked("view_map", "predict", ["a warning"], lambda views: views.predict(np.zeros(3), np.eye(3))),
    Attacked("view_map", "observe", (np.ones(2, bool), ["a warning"]), lambda views: views.observe(EDGES[0], EDGES, None)),
    Attacked("view_map", "add_view", 2, _viewed("add_view")),
    Attacked("view_map", "know_view", 0, lambda views: views.know_view(np.zeros(3), np.eye(3))),
    Attacked("view_map", "pose", (np.ones(3), np.eye(3)), lambda views: views.pose()),
    Attacked("view_map", "views", np.ones((2, 3)), _viewed("views")),
    Attacked("view_map", "view_covariances", np.tile(np.eye(3), (2, 1, 1)), _viewed("view_covariances")),
    Attacked("view_map", "finish", np.ones((3, 3)), _viewed("finish")),
]  # fmt: skip


def made(attacked: Attacked, answer: Any) -> Any:
    """A guarded component that answers so, begun where that is how it comes to be."""
    for kind, begun in BEGUN.items():
        if attacked.kind == begun:
            return guard(Begins(answer), kind, TITLE).begin(
                *[np.zeros(3), np.eye(3)][: 0 if kind == "loop_closure" else 2]
            )
    return guard(Says(answer), attacked.kind, TITLE)


ATTACKS = [
    pytest.param(
        attacked, f"{attacked.kind}.{attacked.method}{path}", part, put, id=f"{attacked.kind}.{attacked.method}{path}"
    )
    for attacked in ATTACKED
    for path, part, put in parts(attacked.sound)
]


@pytest.mark.parametrize("attacked", ATTACKED, ids=lambda a: f"{a.kind}.{a.method}")
def test_what_is_sound_passes(attacked: Attacked) -> None:
    attacked.call(made(attacked, attacked.sound))


@pytest.mark.parametrize(("attacked", "path", "part", "put"), ATTACKS)
def test_a_spoilt_result_is_a_sentence(attacked: Attacked, path: str, part: Any, put: Any) -> None:
    def attack(new: Any) -> None:
        attacked.call(made(attacked, put(attacked.sound, new)))

    each_is_a_sentence(path, part, attack, f"{TITLE}: {attacked.method} returns ")


@pytest.mark.parametrize("attacked", ATTACKED, ids=lambda a: f"{a.kind}.{a.method}")
def test_a_result_that_is_laid_out_otherwise_is_the_same(attacked: Attacked) -> None:
    for path, part, put in parts(attacked.sound):
        if isinstance(part, np.ndarray):
            for same in harmless(part):
                found = attacked.call(made(attacked, put(attacked.sound, same)))
                (again,) = [value for name, value, _ in parts(found) if name == path]
                assert np.array_equal(again, part), path
                assert again.flags.writeable


def test_every_method_is_attacked() -> None:
    attacked = {(a.kind, a.method) for a in ATTACKED}
    opaque = {("descriptor", "fit"), ("descriptor", "restore")}
    assert attacked | opaque == {(kind, method) for kind, methods in CHECKS.items() for method in methods}
    assert {kind.name for kind in KINDS.values() if kind.part} <= set(CHECKS)
