"""Queries against a map of other pictures: refused, said, or as before."""

import logging
from dataclasses import dataclass, replace

import numpy as np
import pytest

from omnilab.api import Circle, Frames, GridPoses, Parts, Places, Plan, Provenance, Signatures
from omnilab.cameras import EquirectangularCamera, HyperbolicMirror, ImageCircle, UnifiedCamera
from omnilab.errors import DataError
from omnilab.runner.recorder import Recorder
from omnilab_studies.common.describing import describe_places, provenance_of
from omnilab_studies.localization.localize.same_pictures import ComparedSensor, differences

MIRROR = Provenance("HyperbolicMirror", 250, 250, (-60.0, 17.5), False, "room", "d1")


def frames_of(camera, color=False):
    shape = (2, camera.height, camera.width, *([3] if color else []))
    return Frames(np.zeros(shape, np.uint8), ["a", "b"], np.arange(2), camera, np.arange(2))


@dataclass
class Taken:
    """Frames of a camera, in two batches, and perhaps the world that they are of."""

    frames_taken: Frames
    imaged_world: tuple[str | None, str | None] = (None, None)

    def plan(self, layout):
        return layout

    def frames(self, plan):
        yield from (self.frames_taken, self.frames_taken)

    def scene(self):
        return None


# ------------------------------------------------------------------------------------------------------- what is known
@pytest.mark.parametrize(("camera", "color", "world", "expected"), [
    (HyperbolicMirror(size=64), False, ("room", "x"),
     ("HyperbolicMirror", 64, 64, (-60.0, 17.5), False, "room", "x")),
    (EquirectangularCamera(64, 32), True, (None, None),
     ("EquirectangularCamera", 64, 32, (-60.0, 60.0), True, None, None)),
    (ImageCircle(20, 16, Circle(9, 8, 7)), False, (None, None), ("ImageCircle", 20, 16, None, False, None, None)),
    (ImageCircle(20, 16, Circle(9, 8, 7), sky_inside=True), False, (None, None),
     ("ImageCircle with the sky inside", 20, 16, None, False, None, None)),
])  # fmt: skip
def test_pictures_say_by_what_they_were_taken(camera, color, world, expected):
    frames = frames_of(camera, color)
    found = provenance_of(frames, Taken(frames, world))
    assert replace(found, elevations_deg=expected[3]) == Provenance(*expected)
    assert (found.elevations_deg is None) == (expected[3] is None)
    assert expected[3] is None or found.elevations_deg == pytest.approx(expected[3], abs=0.5)


def test_a_map_knows_its_pictures(plain):
    parts = Parts(sensor=plain["Floor"](), descriptor=plain["Painted"]())

    places, _ = describe_places(parts, parts.sensor.plan(GridPoses(1.0)), Recorder())
    assert places.provenance == Provenance("ImageCircle", 16, 16, None, False)


# --------------------------------------------------------------------------------------------------------- differences
@pytest.mark.parametrize(("change", "color", "wrong", "notes"), [
    ({}, True, [], []),
    ({"camera": "EquirectangularCamera"}, False,
     ["the map was made by a HyperbolicMirror, these queries by an EquirectangularCamera"], []),
    ({"camera": "UnifiedCamera"}, False, ["the map was made by a HyperbolicMirror, these queries by a UnifiedCamera"], []),
    ({"camera": "ImageCircle", "elevations_deg": None}, False,
     ["the map was made by a HyperbolicMirror, these queries by an ImageCircle"], []),
    ({"elevations_deg": (-60.0, 49.7)}, False,
     ["the map's HyperbolicMirror shows elevations from -60 to 18 degrees, that of these queries from -60 to 50"], []),
    ({"elevations_deg": (-60.0, 18.9)}, False, [], []),  # another day's calibration
    ({"color": True}, False, [], []),  # a descriptor of grey pictures sees no difference
    ({"color": True}, True, ["the map was made of grey pictures, these queries are coloured"], []),
    ({"world": "office", "world_digest": "d2"}, False, ["the map is of the world 'room', these queries of 'office'"], []),
    ({"world": "copy of room"}, False, [], []),  # of the same content
    ({"world_digest": "d2"}, False, [], ["the map is of another variant or state of the world 'room' than these queries"]),
    ({"world": None, "world_digest": None}, False, [], []),  # recorded pictures: nobody knows
    ({"width": 500, "height": 500}, False, [],
     ["the map's pictures have 250 x 250 pixels, those of these queries 500 x 500"]),
])  # fmt: skip
def test_what_forbids_a_comparison_and_what_is_only_said(change, color, wrong, notes):
    assert differences(MIRROR, replace(MIRROR, **change), color) == (wrong, notes)


# ----------------------------------------------------------------------------------------------------------- the sensor
def compared(provenance, camera, allowed=False):
    places = Places(Signatures(np.zeros((1, 3), np.float32)), None, ["a"], {}, provenance)
    return ComparedSensor(Taken(frames_of(camera)), places, False, allowed)


def test_the_first_pictures_are_compared_and_the_sentence_is_said_once(caplog):
    pinned = provenance_of(frames_of(EquirectangularCamera(64, 32)), Taken(None))
    with pytest.raises(
        DataError, match=r"an EquirectangularCamera, these queries by a HyperbolicMirror, .*other_pictures=true"
    ):
        next(compared(pinned, HyperbolicMirror(size=64)).frames(Plan(["a", "b"], None)))
    with caplog.at_level(logging.WARNING, "omnilab"):
        sensor = compared(pinned, HyperbolicMirror(size=64), allowed=True)
        assert len(list(sensor.frames(Plan(["a", "b"], None)))) == 2
        list(sensor.frames(Plan(["a", "b"], None)))
    assert [record.getMessage() for record in caplog.records] == [
        "the map was made by an EquirectangularCamera, these queries by a HyperbolicMirror",
        "the map's pictures have 64 x 32 pixels, those of these queries 64 x 64",
    ]


def test_a_map_of_before_is_used_and_it_is_said_that_nobody_can_tell(caplog):
    camera = UnifiedCamera(width=64, height=48, cx=31.5, cy=23.5, fx=12, fy=12, xi=0.9)
    with caplog.at_level(logging.WARNING, "omnilab"):
        assert len(list(compared(None, camera).frames(Plan(["a", "b"], None)))) == 2
    (record,) = caplog.records
    assert "whether the queries are like them cannot be told" in record.getMessage()


def test_pictures_like_those_of_the_map_are_taken_without_a_word(caplog):
    camera = HyperbolicMirror(size=64)
    same = provenance_of(frames_of(camera), Taken(None))
    with caplog.at_level(logging.WARNING, "omnilab"):
        assert len(list(compared(same, camera).frames(Plan(["a", "b"], None)))) == 2
    assert not caplog.records
