"""The conformance checks need the component alone; what they show it is what they say it is."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from omnilab.api import GridPoses, Metric, NamedPath, PathPoses, RandomPoses, RecordedPoses, Report, Signatures
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import planar_poses
from omnilab.runner.console_sink import Console
from omnilab.testing import check_component, check_study, study_parts
from omnilab.testing.parts import path_frames, signatures_for
from omnilab.testing.room import HIGH, SmallRoom
from omnilab_appearance import (
    ColorShift,
    EpipolarRotation,
    FeatureRotation,
    Gower,
    NoLoopClosure,
    Poc,
    RadonCompression,
    Simulated,
    So3Correlation,
    TinyImage,
)
from omnilab_slam import FastSlam, GtsamBatch, ViewEkf


@dataclass
class Counting:
    """Counts the images of a grid."""

    needs: ClassVar[tuple[str, ...]] = ("sensor", "descriptor", "map", "backends")

    def run(self, parts, record, rng):
        found = sum(len(batch) for batch in parts.sensor.frames(parts.sensor.plan(GridPoses(1.0))))
        return Report([Metric("images", float(found), "1"), Metric("places", float(len(parts.map)), "1")])


@pytest.mark.parametrize(
    ("kind", "component"),
    [
        ("sensor", SmallRoom(48)),
        ("disturbance", ColorShift()),
        ("descriptor", TinyImage()),
        ("distance", Poc()),
        ("localizer", Gower()),
        pytest.param("altimeter", RadonCompression(60, 20), marks=pytest.mark.slow),
        ("odometry", Simulated()),
        ("loop_closure", NoLoopClosure()),
        ("backend", GtsamBatch()),
        ("view_filter", ViewEkf()),
        ("view_filter", FastSlam()),
        ("study", Counting()),
        ("sink", Console()),
    ],
    ids=lambda value: value if isinstance(value, str) else type(value).__name__,
)
def test_a_component_alone_is_enough(kind, component):
    check_component(kind, component)


def test_an_unknown_kind_is_refused():
    with pytest.raises(ConfigError, match=r"kind 'descripter' does not exist.*did you mean descriptor"):
        check_component("descripter", TinyImage())


def test_a_study_that_needs_what_no_plugin_has_says_so():
    check_study(Counting(), study_parts())
    with pytest.raises(AssertionError, match="needs telescope, and no plugin has one; install one, or give `parts`"):
        study_parts(("sensor", "telescope"))


@pytest.mark.parametrize(
    "distance",
    [EpipolarRotation(), pytest.param(FeatureRotation(), marks=pytest.mark.slow), So3Correlation()],
    ids=repr,
)
def test_distances_of_one_descriptor_are_shown_its_signatures(distance):
    signatures, equivariant = signatures_for(distance)
    assert not equivariant
    distance.prepare(signatures)
    with pytest.raises(DataError):
        distance.prepare(Signatures(np.random.default_rng(0).random((2, 24, 36), np.float32)))


# -------------------------------------------------------------------------------------------------------- the room
def test_the_room_looks_as_a_quarter_turn_of_it():
    """Turned to the left by a quarter, the picture turns clockwise by one, pixel by pixel."""
    room, at = SmallRoom(64), [[0.4, -0.3, 1.0]] * 2
    ahead, left = next(room.frames(room.plan(PathPoses(planar_poses(at, [0.2, 0.2 + np.pi / 2]))))).images
    off = np.abs(np.rot90(ahead, k=-1).astype(int) - left)
    assert np.median(off) == 0
    assert (off > 3).mean() < 0.02  # samples that lie on an edge between two texels


def test_the_room_moves_as_the_camera_does():
    """What is ahead grows as it comes nearer: the elevation of the edge between wall and ceiling, by hand."""
    room = SmallRoom(250)
    for x in (-1.0, 1.0):
        direction = np.array([HIGH[0] - x, 0.0, HIGH[2] - 1.0])
        u, v = room.camera.pixels(direction / np.linalg.norm(direction))
        assert u > 125
        assert v == pytest.approx(124.5)
    assert not np.array_equal(*path_frames([0, 1]).images)


@pytest.mark.parametrize(
    "layout", [GridPoses(0.5, extent_m=(2, 1)), RandomPoses(15, 0, np.pi / 2), RecordedPoses(), NamedPath("route")]
)
def test_layouts_are_taken_as_they_say(layout):
    plan = SmallRoom().plan(layout)
    assert len(plan) == {GridPoses: 5 * 3, RandomPoses: 15, RecordedPoses: 24, NamedPath: 24}[type(layout)]
    assert len(set(plan.keys)) >= len(plan) - 1  # the closed path ends where it began


@dataclass
class Holding(Console):
    """Keeps a writer after it was closed, as no sweep can hand on."""

    def open(self, folder):
        super().open(folder)
        self.writer = csv.writer(io.StringIO())


def test_a_sink_that_holds_a_writer_is_told_what_to_drop():
    with pytest.raises(AssertionError, match=r"not pickled \(cannot pickle '_csv.writer' object\); have `close` drop"):
        check_component("sink", Holding())
