"""What odometries, loop closures, back ends and view filters return is checked where it passes to the study."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from omnilab.api import Closures, ImageFeatures, Motion, Optimized, PoseGraph, Unusable
from omnilab.errors import PluginError
from omnilab.runner.boundaries import guard

TITLE = "the component"
UNKNOWN = np.full(3, np.nan)


@dataclass
class Says:
    """A component that returns what it was made with."""

    answer: object = None

    def extract(self, frames):
        return self.answer

    def estimate(self, before, now, rng):
        return self.answer

    def optimize(self, graph, covariances=False):
        return self.answer

    def begin(self, *_):
        return self.answer


def refused(call, *expected):
    with pytest.raises(PluginError) as error:
        call()
    for part in (f"{TITLE}: ", *expected):
        assert part in str(error.value), str(error.value)


# -------------------------------------------------------------------------------------------------------------- odometry
MOTION = Motion(np.zeros(3), np.eye(3), "m")


@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (None, "returns None, not Motion"),
        (replace(MOTION, vector=UNKNOWN), "NaN or infinity in `vector`"),
        (replace(MOTION, vector=np.zeros(2)), "`vector` of shape (2,), not (3,)"),
        (replace(MOTION, covariance=np.eye(2)), "`covariance` of shape (2, 2), not (3, 3)"),
        (replace(MOTION, covariance=np.eye(3) * np.nan), "NaN or infinity in `covariance`"),
        (replace(MOTION, covariance=np.zeros((3, 3))), "positive definite"),
        (replace(MOTION, covariance=-np.eye(3)), "positive definite"),
        (replace(MOTION, covariance=np.triu(np.ones((3, 3)))), "symmetric"),
        (replace(MOTION, unit=None), "`unit` as None, not as a text"),
    ],
)
def test_motions(answer, expected):
    odometry = guard(Says(answer), "odometry", TITLE)
    refused(lambda: odometry.estimate(None, None, None), "estimate returns", expected, "check_odometry")


@pytest.mark.parametrize("answer", [MOTION, Motion(UNKNOWN, np.eye(3), "m", "too dark")])
def test_a_motion_that_failed_and_says_so_is_no_mistake(answer):
    found = guard(Says(answer), "odometry", TITLE).estimate(None, None, None)
    assert found.failed == answer.failed
    assert np.array_equal(found.vector, answer.vector, equal_nan=True)


SHARED = ImageFeatures(
    np.eye(4)[:, :3] + np.eye(4)[3][:, None] * [0, 0, 1], np.zeros((4, 2)), np.zeros((4, 8), np.uint8)
)


@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (None, "returns None, not a sequence"),
        ([], "0 items for 1 images"),
        ([SHARED, SHARED], "2 items for 1 images"),
        ([replace(SHARED, azimuth_level=SHARED.azimuth_level * np.nan)], "NaN or infinity in `azimuth_level`"),
        ([replace(SHARED, vectors=SHARED.vectors[:3])], "`vectors` of shape (3, 8), not (4, any)"),
        ([replace(SHARED, directions=SHARED.directions[:3])], "`directions` of shape (3, 3), not (4, 3)"),
    ],
)
def test_what_odometries_extract(answer, expected):
    refused(lambda: guard(Says(answer), "odometry", TITLE).extract([0]), "extract returns", expected)


@pytest.mark.parametrize("item", [SHARED, Unusable("dark"), "its own business"])
def test_what_odometries_may_extract(item):
    (found,) = guard(Says([item]), "odometry", TITLE).extract([0])
    assert str(found) == str(item)


# ----------------------------------------------------------------------------------------------------------- loop closures
NONE = Closures(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0), 0)
ONE = Closures(np.zeros(1, int), np.zeros((1, 3)), np.eye(3)[None], np.zeros(1), 1)


class Database:
    """Answers one by one."""

    def __init__(self, *answers):
        self.answers = list(answers)

    def query(self, frames, features, step, rng):
        return self.answers.pop(0)


def queried(*answers):
    database = guard(Says(Database(*answers)), "loop_closure", TITLE).begin()
    return [database.query(None, None, 1.0, None) for _ in answers]


@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (None, "returns None, not Closures"),
        (replace(ONE, nodes=np.array([1])), "`nodes` 1, which is no index of the images before this one (from 0 to 0)"),
        (replace(ONE, nodes=np.array([-1])), "`nodes` -1"),
        (replace(ONE, nodes=np.array([0.0])), "`nodes` of type float64, not whole"),
        (replace(ONE, motions=np.full((1, 3), np.nan)), "NaN or infinity in `motions`"),
        (replace(ONE, motions=np.zeros((2, 3))), "`motions` of shape (2, 3), not (1, 3)"),
        (replace(ONE, covariances=np.zeros((1, 3, 3))), "positive definite"),
        (replace(ONE, distances=np.full(1, np.inf)), "NaN or infinity in `distances`"),
        (replace(ONE, candidates=-1), "`candidates` -1, below 0"),
    ],
)
def test_closures(answer, expected):
    assert [len(found.nodes) for found in queried(NONE, ONE)] == [0, 1]
    refused(lambda: queried(NONE, answer), "query returns", expected, "PlaceDatabase", "check_loop_closure")


def test_the_first_image_closes_no_loop():
    refused(lambda: queried(ONE), "none, for there are none")
    refused(lambda: guard(Says(5), "loop_closure", TITLE).begin(), "begin returns int, which has no query")


# ---------------------------------------------------------------------------------------------------------------- graphs
GRAPH = PoseGraph(
    np.arange(3), np.zeros((3, 3)), np.array([[0, 1], [1, 2]]), np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1))
)
OPTIMUM = Optimized(np.zeros((3, 3)), 2.0, 1.0, 4, np.ones(2), np.tile(np.eye(3), (3, 1, 1)))  # fmt: skip


@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (None, "returns None, not Optimized"),
        (replace(OPTIMUM, poses=np.zeros((2, 3))), "poses of shape (2, 3), not (3, 3)"),
        (replace(OPTIMUM, poses=np.full((3, 3), np.nan)), "NaN or infinity in poses (100 % of all numbers, in 3 of 3 nodes"),
        (replace(OPTIMUM, chi2=np.nan), "`chi2` nan, not a finite number"),
        (replace(OPTIMUM, chi2_before=None), "`chi2_before` as None"),
        (replace(OPTIMUM, iterations=2.5), "`iterations` as float, not as a whole number"),
        (replace(OPTIMUM, weights=np.full(2, np.nan)), "NaN or infinity in `weights`"),
        (replace(OPTIMUM, weights=np.full(2, 1.5)), "`weights` outside of [0, 1]"),
        (replace(OPTIMUM, weights=np.ones(3)), "`weights` of shape (3,), not (2,)"),
        (replace(OPTIMUM, covariances=-OPTIMUM.covariances), "no variance of theirs is negative"),
        (replace(OPTIMUM, warnings="oh"), "`warnings` as str"),
    ],
)  # fmt: skip
def test_optima(answer, expected):
    back_end = guard(Says(answer), "backend", TITLE)
    refused(lambda: back_end.optimize(GRAPH, covariances=True), "optimize returns", expected, "check_backend")


def test_spatial_poses_have_unit_quaternions():
    graph = replace(GRAPH, poses=np.tile([0.0, 0, 0, 0, 0, 0, 1], (3, 1)), information=np.tile(np.eye(6), (2, 1, 1)))
    sound = replace(OPTIMUM, poses=graph.poses, covariances=None)
    assert np.array_equal(guard(Says(sound), "backend", TITLE).optimize(graph).poses, sound.poses)
    spoilt = replace(sound, poses=graph.poses * [1, 1, 1, 1, 1, 1, 2])
    refused(lambda: guard(Says(spoilt), "backend", TITLE).optimize(graph), "number 0 has no unit quaternion")


class Incremental:
    """A graph whose poses are given."""

    def __init__(self, poses):
        self.found, self.me = poses, self  # as one that is bound to itself

    def add(self, pose, edges, motions, information):
        return []

    def pose(self, number):
        return self.found[number]

    def poses(self):
        return self.me.found


def test_graphs_that_grow():
    made = Incremental(np.zeros((1, 3)))
    graph = guard(Says(made), "backend", TITLE).begin(np.zeros(3))
    assert graph is made
    assert graph.poses().shape == (1, 3)
    graph.add(None, None, None, None)
    refused(graph.poses, "poses returns poses of shape (1, 3), not (2, 3)")
    made.found = np.zeros((2, 3))
    assert graph.poses().shape == (2, 3)
    made.found = made.found * np.nan
    refused(graph.poses, "poses returns NaN or infinity in poses", "IncrementalGraph")
    refused(lambda: graph.pose(1), "pose returns NaN or infinity in a pose")


# -------------------------------------------------------------------------------------------------------------- view maps
class Views:
    """A map of views that returns what it is told."""

    answer: object = None

    def _answer(self, *_):
        return self.answer

    predict = observe = add_view = know_view = pose = views = view_covariances = finish = _answer


@pytest.mark.parametrize(
    ("method", "arguments", "answer", "expected"),
    [
        ("predict", (0, 0), None, "warnings as None"),
        ("observe", ([1, 2], 0, 0), (np.ones(1, bool), []), "which views it believes of shape (1,), not (2,)"),
        ("observe", ([1], 0, 0), None, "None, not which views"),
        ("observe", ([1], 0, 0), (np.ones(1), []), "of type float64, not bool"),
        ("add_view", (), -1, "the view's number -1, below 0"),
        ("add_view", (), 1.0, "the view's number as float"),
        ("pose", (), np.zeros(3), "not a pose and its covariance"),
        ("pose", (), (UNKNOWN, np.eye(3)), "NaN or infinity in a pose"),
        ("pose", (), (np.zeros(3), np.eye(3) * np.nan), "NaN or infinity in a covariance"),
        ("views", (), np.full((2, 3), np.nan), "NaN or infinity in poses (100 % of all numbers, in 2 of 2 views"),
        ("view_covariances", (), np.full((2, 3, 3), np.nan), "NaN or infinity in covariances"),
        ("finish", (), np.zeros((2, 2)), "poses of shape (2, 2), not (any, 3)"),
    ],
)
def test_maps_of_views(method, arguments, answer, expected):
    views = guard(Says(Views()), "view_filter", TITLE).begin(np.zeros(3), np.eye(3))
    views.answer = answer
    refused(lambda: getattr(views, method)(*arguments), f"{method} returns", expected, "ViewMap", "check_view_filter")
