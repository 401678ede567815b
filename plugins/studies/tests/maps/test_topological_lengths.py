"""Lengths of a map's springs: thresholds, each image's own scale, several methods, slopes, rooms."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree

from omnilab.api import Match, Parts
from omnilab.errors import ConfigError, DataError
from omnilab.runner.recorder import Recorder
from omnilab_studies import TopologicalMap
from omnilab_studies.local_maps.topological_map.lengths import (
    Lengths,
    connecting_threshold,
    slope_of,
    sum_of_scaled,
    up_to_threshold,
)


@dataclass
class Warped:
    """Metres, times a factor that rises ninefold along x: images change faster beside the furniture there."""

    def prepare(self, places):
        return places.place

    def match(self, queries, index):
        x = 0.5 * (queries.place[:, None, 0] + index[None, :, 0])
        apart = np.linalg.norm(queries.place[:, None] - index[None], axis=-1)
        return Match((apart * 3.0 ** (x / 120 + 1)).astype(np.float32))


@dataclass
class Springs:
    """Scaling that has a slope, keeps what it was given, and takes distances that do not count for 1."""

    inner: object
    slope: float | None = None
    given: tuple = ()

    def prepare(self, places, distance):
        raise AssertionError("a study of maps asks for maps")

    locate = prepare

    def embed(self, distance, rng, steps=0):
        slopes.append((distance.shape[1], self.slope))
        return self.inner.embed(np.where(np.isfinite(distance), distance, 1), rng, steps)


slopes: list = []


@pytest.fixture
def parts(plain):
    return Parts(
        sensor=plain["Floor"](), descriptors={"painted": plain["Painted"]()},
        default_distances={"painted": plain["Apart"]()}, localizers={"scaling": plain["Scaling"]()},
    )  # fmt: skip


def run(parts, **settings):
    settings = {"steps_m": [0.5], "nodes": [7, 5], "links": [0], **settings}
    return TopologicalMap(**settings).run(parts, Recorder(), np.random.default_rng(1))


def lengths_of(points):
    return np.linalg.norm(points[:, None] - points, axis=2)


clouds = st.tuples(st.integers(3, 12), st.integers(0, 2**32 - 1)).map(
    lambda made: np.random.default_rng(made[1]).normal(size=(made[0], 2))
)


@given(clouds, st.floats(0.05, 3))
def test_the_least_threshold_that_connects_is_the_longest_edge_of_the_spanning_tree(points, share):
    length = lengths_of(points)
    least = connecting_threshold(length)
    assert least == pytest.approx(minimum_spanning_tree(length).max())
    parts, _ = connected_components(length <= share * least, directed=False)
    if share < 1:
        with pytest.raises(DataError, match=f"a threshold of .* in {parts} parts, the largest of"):
            up_to_threshold(length, share)
    else:
        kept = up_to_threshold(length, share)
        assert (np.isfinite(kept) == (length <= share * least)).all()
        assert (kept[np.isfinite(kept)] == length[np.isfinite(kept)]).all()


@given(clouds, st.integers(1, 12), st.floats(0.01, 100))
def test_the_scale_of_a_method_does_not_matter(points, links, scale):
    length = lengths_of(points)
    assert np.allclose(sum_of_scaled([length, scale * length], links), sum_of_scaled([length], links))


def test_distances_are_measured_on_the_scale_of_their_images():
    line = np.array([0.0, 1, 3, 7])  # mean distances to the two nearest: 2, 1.5, 2.5, 5
    scaled = sum_of_scaled([np.abs(line[:, None] - line)], 2)
    assert scaled[0, 1] == pytest.approx(1 / np.sqrt(2 * 1.5))
    assert scaled[2, 3] == pytest.approx(4 / np.sqrt(2.5 * 5))


def test_the_slope_is_that_of_the_near_pairs():
    points = np.random.default_rng(0).uniform(0, 2, (30, 2))
    apart = lengths_of(points)
    assert slope_of(np.minimum(3 * apart, 2.1), points, 0.7) == pytest.approx(3)
    assert slope_of(np.minimum(3 * apart, 2.1), points, 3.0) < 2.5
    with pytest.raises(DataError, match=r"no two images are within study.slope_m=1e-09"):
        slope_of(apart, points, 1e-9)
    with pytest.raises(DataError, match="all images are alike"):
        slope_of(np.zeros_like(apart), points, 1.0)


def test_their_own_scale_evens_what_changes_faster_at_one_end(parts):
    table = run(replace(parts, default_distances={"painted": Warped()}), links=[0, 8], conformal=[8]).tables[
        "topological_maps"
    ]
    rms = dict(zip(table["lengths"], table["rms_steps"], strict=True))
    assert rms["conformal_8"] < 0.5 * min(rms["all"], rms["8"])


def test_a_threshold_that_parts_the_images_is_said_with_their_parts(parts, plain):
    report = run(replace(parts, localizers={"springs": Springs(plain["Scaling"]())}), thresholds=[1.0, 0.9])
    assert report.tables["topological_maps"]["lengths"] == ["all", "threshold_1"]
    assert "threshold 0.9: a threshold of 0.9 leaves the 35 images in 35 parts, the largest of 1" in report.omitted[0]


def test_several_methods_make_one_map(parts, plain):
    both = replace(parts, distances={"near": plain["Apart"](), "warped": Warped()})
    report = run(both, conformal=[8], combined=["painted + near", "painted + warped"])
    table = report.tables["topological_maps"]
    assert table["method"][-1] == "combined"
    named = {metric.name: metric.value for metric in report.metrics}
    assert named["rms_steps_combined_conformal_8_scaling_at_0.5_m"] == table["rms_steps"][-1]
    assert named["best_rms_steps_conformal_8_at_0.5_m"] == min(table["rms_steps"][1::2] + table["rms_steps"][-1:])


def test_the_slope_of_the_first_room_is_that_of_all(parts, plain):
    slopes.clear()
    springs = replace(parts, localizers={"springs": Springs(plain["Scaling"]())})
    run(springs, steps_m=[0.5, 1.0], slope_m=1.0, links=[0, 8], thresholds=[1.5])
    given = [slope for count, slope in slopes if count > 3]  # not those of the first three points, for practice
    assert given[0] is not None
    assert given == [given[0], None, given[0]] * 2  # paths along links have no unit
    with pytest.raises(ConfigError, match=r"study.slope_m=1 measures the slope of localizers that have one"):
        run(parts, slope_m=1.0)


def test_each_step_has_its_room(parts):
    rooms = {"hall": {}, "laboratory": {"blocked": [[0.0, 0.0]]}}
    table = run(parts, steps_m=[0.5, 1.0], rooms=rooms).tables["topological_maps"]
    assert table["room"] == ["hall", "laboratory"]
    assert table["nodes"][0] == 35


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"rooms": {"hall": {}}, "steps_m": [0.5, 1.0]}, "study.rooms holds 1 rooms for the 2 steps"),
        ({"combined": ["painted"]}, r"there are none; give study.conformal=\[6\]"),
        ({"combined": ["paint"], "conformal": [6]}, "names 'paint', which is no method of the run; there is painted"),
        ({"rooms": {"hall": {"wold": "room"}}}, r"study.rooms.hall changes 'wold', which is no setting of the sensor"),
        ({"thresholds": [0.0]}, "study.thresholds=.* holds 0, which is out of range"),
    ],
)
def test_settings_that_make_no_map_are_refused(parts, settings, words):
    with pytest.raises(ConfigError, match=words):
        run(parts, **settings)


def test_lengths_have_names():
    made = [Lengths(), Lengths(8), Lengths(threshold=1.25), Lengths(6, conformal=True)]
    assert [one.name for one in made] == ["all", "8", "threshold_1.25", "conformal_6"]
