"""What a run says of descriptors that break a promise no single result shows; and nothing of the built-in ones."""

from __future__ import annotations

import logging
import pickle
from dataclasses import dataclass

import numpy as np
import pytest

from omnilab import api
from omnilab.api import Signatures
from omnilab.runner.boundaries import SpotCheck, guard, spot_checks
from omnilab.runner.registry import discover
from omnilab.testing.common import smooth_images
from omnilab_appearance import RotationalPca, TinyImage

SLOW_ONES = {
    "gist",
    "hog",
    "hog_grid",
    "spherical_sift",
    "radon",
    "radon_gist",
    "radon_hog_grid",
    "radon_hog",
}  # to import or to compile


def warned(caplog, descriptor, images=None):
    """The warnings while a descriptor describes two batches."""
    watched = guard(descriptor, "descriptor", "descriptor 'mine'", SpotCheck(descriptor, "descriptor 'mine'", "mine"))
    images = smooth_images(descriptor.view, descriptor.color) if images is None else images
    with caplog.at_level(logging.WARNING, "omnilab"):
        if isinstance(descriptor, api.Trainable):
            watched = watched.fit(images)
        first = watched.describe(images)
        watched.describe(images[:2])
    return [record.getMessage() for record in caplog.records], first


@dataclass
class Centered(TinyImage):
    def describe(self, images):
        place = super().describe(images).place
        return Signatures(place - place.mean(axis=0))


@dataclass
class Turning(TinyImage):
    rotation = "invariant"


@dataclass
class Holding(TinyImage):
    def describe(self, images):
        place = super().describe(images).place
        self.buffer = getattr(self, "buffer", np.zeros((50, *place.shape[1:]), np.float32))
        self.buffer[: len(place)] = place
        return Signatures(self.buffer[: len(place)])


@dataclass
class Counting(TinyImage):
    calls: int = 0

    def describe(self, images):
        self.calls += 1
        return Signatures(super().describe(images).place + np.float32(self.calls))


@dataclass
class Refusing(TinyImage):
    def describe(self, images):
        if len(images) == 1:
            raise IndexError("one")
        return super().describe(images)


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (Centered, "describes an image otherwise alone than in a batch"),
        (Turning, "declares rotation='invariant', but a quarter turn does something else"),
        (Holding, "returns one buffer for every call"),
        (Counting, "describes the same image otherwise the second time"),
        (Refusing, "raises IndexError when the first image is described again, alone or turned: one"),
    ],
)
def test_a_broken_promise_is_one_warning(caplog, kind, words):
    (found,), _ = warned(caplog, kind(), smooth_images("panorama", False))
    assert found.startswith(f"descriptor 'mine' {words}")
    assert found.endswith("omnilab check descriptor=mine says more")


def test_one_that_takes_a_quarter_of_a_second_for_a_panorama_is_slow(caplog, monkeypatch):
    monkeypatch.setattr(spot_checks, "_timed", lambda describe, image: (describe(image), 0.25))
    monkeypatch.setattr(spot_checks, "_transform_s", lambda _: 0.0014)
    (found,), _ = warned(caplog, TinyImage())
    assert "takes 0.25 s for an image, as long as 179 Fourier transforms of it" in found
    caplog.clear()
    monkeypatch.setattr(spot_checks, "_transform_s", lambda _: 0.0025)
    assert warned(caplog, TinyImage())[0] == []


def test_the_results_are_those_without(caplog):
    images = smooth_images("panorama", color=False)
    _, found = warned(caplog, Counting(), images)
    assert np.array_equal(found.place, Counting().describe(images).place)


@pytest.mark.parametrize("name", sorted(set(discover("").names("descriptor")) - SLOW_ONES - {"onnx"}))
def test_built_in_ones_give_no_warning(caplog, name):
    assert warned(caplog, discover("").get("descriptor", name).cls())[0] == []


def test_what_is_trained_is_tried_where_it_describes(caplog):
    assert warned(caplog, RotationalPca(components=3))[0] == []


def test_pictures_that_cannot_be_turned_by_a_quarter_are_left_alone(caplog):
    assert warned(caplog, Turning(), smooth_images("panorama", False)[:, :, :510])[0] == []


def test_a_guarded_descriptor_still_pickles():
    watched = guard(TinyImage(), "descriptor", "mine", SpotCheck(TinyImage(), "mine"))
    assert pickle.loads(pickle.dumps(watched)).rows == TinyImage().rows
