"""Local maps where image distances are metres, and the errors for maps that cannot be made."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnilab.api import Embedding, Graph, Parts, RandomPoses, Signatures
from omnilab.errors import ConfigError, DataError
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_study
from omnilab_studies import LocalMap
from omnilab_studies.local_maps.display import FULL, nearest_edges, springs
from omnilab_studies.local_maps.embedders import embed_from_seeds
from omnilab_studies.local_maps.results import LocalMapCase, LocalMapTimes, score_local_maps

SQUARE = np.array([[0, 0], [1, 0], [0, 1], [1, 1], [0.5, 0.4]])
ROUNDING_M = 2 / 60  # positions are painted in whole grey levels, 60 a metre


class Log(Recorder):
    """Keeps what is logged."""

    def __init__(self):
        super().__init__()
        self.logged = []

    def log(self, path, record, tick=None):
        self.logged.append((path, record, tick))


@pytest.fixture
def parts(plain):
    apart = plain["Apart"]()
    return Parts(
        sensor=plain["Floor"](), descriptor=plain["Painted"](), distance=apart, descriptors={"painted": plain["Painted"]()},
        default_distances={"painted": apart}, localizers={"scaling": plain["Scaling"]()},
    )  # fmt: skip


def run(parts, record=None, **settings):
    settings = {"steps_m": [0.5], "neighbours": [9], "query_count": 12, "starts": 2, **settings}
    return LocalMap(**settings).run(parts, record or Recorder(), np.random.default_rng(1))


def transformed(points, angle, mirror, scale, shift):
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ np.diag([mirror, 1])
    return scale * points @ R.T + shift


def scored(planes, points):
    made = [Embedding(plane[None], np.zeros(1), np.ones(1, int)) for plane in planes]
    case = LocalMapCase(0.2, len(points) - 1, "any", "any")
    return score_local_maps(case, made, points[None, :-1], points[None, -1], 9, LocalMapTimes(0, 0, 0))


# ------------------------------------------------------------------------------------------------------------ scores
@given(
    st.floats(-3, 3), st.sampled_from([-1, 1]), st.floats(0.1, 10), st.floats(-5, 5), st.floats(0, 1), st.floats(0, 1)
)
def test_the_error_is_that_of_the_query_after_the_places_fit(angle, mirror, scale, shift, x, y):
    moved = SQUARE.copy()
    moved[-1] += x, y
    found = scored(
        [transformed(SQUARE, angle, mirror, scale, shift), transformed(moved, angle, mirror, scale, shift)], SQUARE
    )
    assert found.error_m[0] == pytest.approx([0, np.hypot(x, y)], abs=1e-9)
    assert found.all_points_m[0, 1] <= found.error_m[0, 1] + 1e-9  # the query pulls the fit to itself
    assert found.centroid_m[0] == pytest.approx(0.1)
    assert found.nearest_m[0] == pytest.approx(np.hypot(0.5, 0.4))


def test_places_on_a_line_are_counted():
    points = np.array([[0, 0], [1, 0], [2, 0], [1, 1.0]])
    assert scored([points], points).on_a_line.all()
    assert not scored([SQUARE], SQUARE).on_a_line.any()


# ------------------------------------------------------------------------------------------------------------- a run
def test_metres_make_exact_maps(parts):
    report = run(parts, steps_m=[0.5, 1], neighbours=[5, 9])
    table = report.tables["local_maps"]
    assert list(zip(table["step_m"], table["neighbours"], strict=True)) == [(0.5, 5), (0.5, 9), (1, 5), (1, 9)]
    assert max(table["p95_m"]) < ROUNDING_M < min(table["centroid_median_m"])
    assert min(table["better_than_centroid"]) > 0.8
    names = [metric.name for metric in report.metrics[:3]]
    assert names == ["best_error_median", "centroid_error_median", "best_better_than_centroid"]
    assert all(metric.interval[0] <= metric.value <= metric.interval[1] for metric in report.metrics[:3])
    assert set(report.figures) == {"errors_scaling", "times", "maps"}


def test_centroid_and_nearest_are_those_of_the_most_alike_places(parts):
    report = run(parts, neighbours=[3])
    (asked,) = [layout for layout in parts.sensor.asked if isinstance(layout, RandomPoses)]
    truth_m = np.random.default_rng(asked.seed).uniform(0, [4, 3], (12, 2))
    x, y = np.meshgrid(0.5 * np.arange(9), 0.5 * np.arange(7))
    places_m = np.column_stack([x.ravel(), y.ravel()])
    seen = [np.round(60 * at).astype(int) for at in (truth_m, places_m)]
    apart = np.linalg.norm(seen[0][:, None] - seen[1], axis=2)
    nearest_m = np.linalg.norm(truth_m - places_m[apart.argmin(axis=1)], axis=1)
    near = np.argsort(apart, axis=1, kind="stable")[:, :3]
    centroid_m = np.linalg.norm(truth_m - places_m[near].mean(axis=1), axis=1)
    table = report.tables["local_maps"]
    assert table["nearest_median_m"][0] == pytest.approx(np.median(nearest_m))
    assert table["centroid_median_m"][0] == pytest.approx(np.median(centroid_m))
    assert report.tables["errors"]["centroid_m"][::2] == pytest.approx(centroid_m.tolist())


def test_every_start_is_scored_apart(parts, plain):
    shaken, scaling = plain["Shaken"](), plain["Scaling"]()
    report = run(replace(parts, localizers={"shaken": shaken, "scaling": scaling}), starts=4, show=1)
    table = report.tables["errors"]
    errors = {
        name: np.array([e for e, n in zip(table["error_m"], table["localizer"], strict=True) if n == name]).reshape(
            12, 4
        )
        for name in ("shaken", "scaling")
    }
    assert np.ptp(errors["shaken"], axis=1).min() > 0
    assert not np.ptp(errors["scaling"], axis=1).any()
    assert shaken.asked.count(12) == 4 + 1  # and once to be timed
    assert scaling.asked.count(12) == 2 + 1  # its second map shows that it draws nothing


def test_the_study_is_sound(parts, plain):
    check_study(LocalMap([0.5], [5], 5, 2), replace(parts, localizers={"shaken": plain["Shaken"]()}))


def test_the_map_settles_in_the_log(parts):
    record = Log()
    run(parts, record, show=2)
    maps = [(graph, tick.step) for path, graph, tick in record.logged if path == "map"]
    assert [step for _, step in maps] == list(range(80))
    assert all(isinstance(graph, Graph) and graph.position_m.shape == (10, 3) for graph, _ in maps)
    truths = [graph for path, graph, _ in record.logged if path == "truth"]
    assert np.allclose(maps[-1][0].position_m, truths[-1].position_m, atol=ROUNDING_M)


def test_methods_that_cannot_compare_the_images_are_omitted(parts, plain):
    descriptors = {"painted": plain["Painted"](), "shifting": plain["Shifting"]()}
    distances = {"apart": plain["Apart"](), "picky": plain["Picky"]()}
    report = run(replace(parts, descriptors=descriptors, distances=distances))
    assert report.tables["local_maps"]["method"] == ["painted + apart"]
    omitted = " ".join(report.omitted)
    assert "painted + picky: signatures of shape (4,)" in omitted
    assert "shifting + apart: the camera turns between images" in omitted
    with pytest.raises(DataError, match="none of the distances"):
        run(replace(parts, descriptors={"painted": plain["Painted"]()}, distances={"picky": plain["Picky"]()}))


def test_repeated_places_are_no_trouble(parts):
    floor = parts.sensor
    once = floor.plan
    floor.plan = lambda layout: once(layout) if isinstance(layout, RandomPoses) else twice(once(layout))
    table = run(parts, steps_m=[1.0], neighbours=[8]).tables["local_maps"]
    assert table["p95_m"][0] < ROUNDING_M


def twice(plan):
    return plan.at(np.repeat(np.arange(len(plan)), 2))


def test_places_on_one_line_are_in_the_table(parts, plain):
    rows = [[x, y] for x in range(5) for y in (1, 2, 3)]
    table = run(replace(parts, sensor=plain["Floor"](blocked=rows)), steps_m=[1.0], neighbours=[4]).tables["local_maps"]
    assert table["on_a_line"] == [12]


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"neighbours": [9, 2]}, "holds 2, which is out of range; give 1 or more whole numbers from 3 to 10000"),
        ({"neighbours": []}, "holds 0 numbers"),
        ({"steps_m": [0.2, 0]}, "holds 0, which is out of range"),
        ({"query_count": 0}, "study.query_count=0"),
        ({"starts": 0}, "study.starts=0"),
        ({"extent_m": [1]}, "holds 1 number; give 2 numbers above 0"),
    ],
)
def test_settings_that_make_no_map_are_refused(settings, words):
    with pytest.raises(ConfigError, match=words):
        LocalMap(**settings)


def test_a_map_with_too_few_places_is_named(parts):
    with pytest.raises(DataError, match=r"step of 1 m has 20 places, fewer than the 25"):
        run(parts, steps_m=[0.5, 1], neighbours=[9, 25])
    assert parts.localizers["scaling"].asked == []  # before the work


def test_a_localizer_without_maps_is_named(parts):
    class Answers:
        def prepare(self, places, distance): ...
        def locate(self, queries, index): ...

    with pytest.raises(ConfigError, match=r"localizers.plain is a Answers, which makes no map.*spring"):
        run(replace(parts, localizers={"plain": Answers()}))


def test_distances_that_are_no_numbers_are_an_error(parts, plain):
    class Broken(plain["Painted"]):
        def describe(self, images):
            return Signatures(super().describe(images).place * np.float32(np.nan))

    with pytest.raises(DataError, match="some distances of broken are no numbers"):
        run(replace(parts, descriptors={"broken": Broken()}, default_distances={"broken": plain["Apart"]()}))


# ----------------------------------------------------------------------------------------------------------- springs
def test_springs_show_their_strain():
    position_m = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    length_m = np.array([[0, 1, 2.0], [1, 0, 1 / (1 + FULL)], [2.0, 1 / (1 + FULL), 0]])
    length_m[1, 2] = length_m[2, 1] = np.sqrt(2) / (1 + FULL)
    rest, compressed, stretched = springs(position_m, length_m, np.array([[0, 1], [0, 2], [1, 2]])).colors.astype(int)
    assert np.ptp(rest) < 20
    assert compressed[2] - compressed[0] > 100
    assert stretched[0] - stretched[2] > 100


@given(st.integers(2, 8), st.integers(1, 9), st.integers(0, 2**32 - 1))
def test_every_point_has_springs_to_its_nearest(n, count, seed):
    points = np.random.default_rng(seed).normal(size=(n, 2))
    length = np.linalg.norm(points[:, None] - points, axis=2)
    edges = nearest_edges(length, count)
    assert (edges[:, 0] < edges[:, 1]).all()
    assert len(np.unique(edges, axis=0)) == len(edges)
    pairs = {frozenset(edge) for edge in edges.tolist()}
    for i in range(n):
        others = sorted((j for j in range(n) if j != i), key=lambda j: length[i, j])[:count]
        assert all(frozenset((i, j)) in pairs for j in others)


def test_an_embedder_that_draws_embeds_from_every_seed(plain):
    length = np.linalg.norm(SQUARE[:, None] - SQUARE, axis=2)[None]
    shaken = plain["Shaken"]()
    made = embed_from_seeds(shaken, length, range(3))
    assert shaken.asked == [1, 1, 1]
    assert len({m.position.tobytes() for m in made}) == 3
