"""Maps of whole grids, where the truth is known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse.csgraph import csgraph_from_dense, shortest_path

from omnilab.api import Embedding, Match, Parts, PathPoses
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import heading_of
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_study
from omnilab_studies import TopologicalMap
from omnilab_studies.common.free_area import window
from omnilab_studies.local_maps.topological_map.lengths import Lengths, geodesic
from omnilab_studies.local_maps.topological_map.results import (
    TopologicalMapCase,
    TopologicalMapResult,
    grid_edges,
)


@dataclass
class Saturating:
    """Metres up to a length, and hardly more beyond."""

    most: float = 60.0

    def prepare(self, places):
        return places.place

    def match(self, queries, index):
        apart = np.linalg.norm(queries.place[:, None] - index[None], axis=-1)
        return Match(np.where(apart > self.most, self.most + 0.01 * apart, apart).astype(np.float32))


@pytest.fixture
def parts(plain):
    return Parts(
        sensor=plain["Floor"](), descriptors={"painted": plain["Painted"]()},
        default_distances={"painted": plain["Apart"]()}, localizers={"scaling": plain["Scaling"]()},
    )  # fmt: skip


def run(parts, record=None, **settings):
    settings = {"steps_m": [0.5], "nodes": [5, 4], **settings}
    return TopologicalMap(**settings).run(parts, record or Recorder(), np.random.default_rng(1))


def grid(columns, rows, step=1.0):
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    return step * np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def a_map(found, truth, step=1.0):
    made = Embedding(np.asarray(found, float)[None], np.zeros(1), np.ones(1, int))
    return TopologicalMapResult(
        TopologicalMapCase(step, "any", Lengths(), "any"), truth, np.zeros((len(truth), len(truth))), made, 0.0
    )


# ------------------------------------------------------------------------------------------------------------ scores
def test_a_rotated_mirrored_and_scaled_grid_has_no_residual():
    truth = grid(4, 3)
    one = a_map(3 * truth[:, [1, 0]] * (1, -1) + 7, truth)
    assert one.rms_m == pytest.approx(0, abs=1e-9)
    assert one.neighbours_kept == 1


def test_two_nodes_that_change_places_are_seen():
    truth = grid(4, 4)
    found = truth[:, :2].copy()
    found[[0, 15]] = found[[15, 0]]
    one = a_map(found, truth)
    assert one.neighbours_kept < 1
    assert one.rms_steps > 1


def test_the_residual_is_counted_in_steps():
    truth = grid(3, 3, 0.5)
    found = truth[:, :2] * (1, 1.2)
    assert a_map(found, truth, 0.5).rms_steps == pytest.approx(2 * a_map(found, truth, 0.5).rms_m)


@given(st.integers(1, 5), st.integers(1, 5))
def test_a_grid_has_its_edges(columns, rows):
    assert len(grid_edges(grid(columns, rows, 0.3), 0.3)) == (columns - 1) * rows + columns * (rows - 1)


@given(st.integers(3, 9), st.integers(1, 9), st.integers(0, 2**32 - 1))
def test_paths_are_the_shortest_along_links(n, links, seed):
    points = np.random.default_rng(seed).normal(size=(n, 2))
    length = np.linalg.norm(points[:, None] - points, axis=2)
    graph = np.full((n, n), np.inf)
    for i in range(n):
        near = np.argsort(length[i])[1 : links + 1]
        graph[i, near] = graph[near, i] = length[i, near]
    paths = shortest_path(csgraph_from_dense(graph, null_value=np.inf), method="D")
    if np.isinf(paths).any():
        with pytest.raises(DataError, match=r"in [0-9]+ parts"):
            geodesic(length, links)
    else:
        assert np.allclose(geodesic(length, links), paths)


def test_repeated_images_are_linked():
    line = np.array([0.0, 0, 0, 1, 2])
    assert np.allclose(geodesic(np.abs(line[:, None] - line), 3), np.abs(line[:, None] - line), atol=1e-6)


@given(st.integers(2, 7), st.integers(2, 7), st.integers(1, 8), st.integers(1, 8), st.integers(0, 2**32 - 1))
def test_the_window_has_the_fewest_gaps(columns, rows, wide, high, seed):
    rng = np.random.default_rng(seed)
    nodes = grid(columns, rows, 0.5)[rng.random(columns * rows) < 0.7, :2] - 1
    if len(nodes) == 0:
        return
    found = nodes[window(nodes, 0.5, [wide, high], [0, 0])]
    assert (np.ptp(found, axis=0) <= 0.5 * np.array([wide - 1, high - 1]) + 1e-9).all()
    for corner in nodes.min(axis=0) + 0.5 * np.array([[i, j] for i in range(columns) for j in range(rows)]):
        reach = corner + 0.5 * np.array([wide - 1, high - 1]) + 1e-9
        assert ((nodes >= corner - 1e-9) & (nodes <= reach)).all(axis=1).sum() <= len(found)


def test_of_two_windows_the_one_nearest_to_the_middle_is_taken():
    nodes = grid(9, 2)[:, :2]
    assert nodes[window(nodes, 1.0, [3, 2], [6.2, 0])].mean(axis=0) == pytest.approx([6, 0.5])


# ------------------------------------------------------------------------------------------------------------- a run
def test_metres_make_exact_maps(parts):
    report = run(parts, steps_m=[0.5, 1.0], links=[0, 20])
    table = report.tables["topological_maps"]
    assert table["nodes"] == [20] * 4
    assert max(table["rms_m"]) < 1 / 60
    assert table["neighbours_kept"] == [1] * 4
    assert [metric.name for metric in report.metrics[:3]] == ["best_rms_steps", "best_rms", "best_neighbours_kept"]
    assert set(report.figures) == {"maps_0.5_m", "maps_1_m", "best_0.5_m", "best_1_m"}


def test_links_mend_what_saturates(parts):
    saturating = replace(parts, default_distances={"painted": Saturating()})
    table = run(saturating, nodes=[9, 7], links=[0, 8]).tables["topological_maps"]
    rms = dict(zip(table["links"], table["rms_steps"], strict=True))
    assert rms[8] < 0.5 * rms[0]


def test_the_study_is_sound(parts):
    check_study(TopologicalMap([0.5], [5, 4]), parts)


def test_headings_are_those_asked_for(parts):
    run(parts)
    assert not any(isinstance(layout, PathPoses) for layout in parts.sensor.asked)
    run(parts, random_headings=True)
    (layout,) = [layout for layout in parts.sensor.asked if isinstance(layout, PathPoses)]
    assert np.ptp(heading_of(layout.T_world_camera)) > 1


def test_rotated_cameras_need_a_distance_that_is_rotation_invariant(parts, plain):
    shifting = replace(parts, descriptors={"painted": plain["Shifting"]()})
    assert run(shifting).tables["topological_maps"]["method"] == ["painted"] * 2
    with pytest.raises(DataError, match="the camera turns between images"):
        run(shifting, random_headings=True)


def test_links_that_leave_parts_are_an_error(parts, plain):
    wall = [[x, y] for x in (1.5, 2.0, 2.5) for y in 0.5 * np.arange(7)]
    with pytest.raises(
        DataError, match=r"not one map .* 2 links: so few links leave the 42 images in 2 parts, the largest of 21;"
    ):
        run(replace(parts, sensor=plain["Floor"](blocked=wall)), nodes=[9, 7], links=[2])


def test_a_line_of_images_is_refused(parts, plain):
    rows = [[x, y] for x in range(5) for y in (1, 2, 3)]
    with pytest.raises(DataError, match="5 images with a step of 1 m lie on one line"):
        run(replace(parts, sensor=plain["Floor"](blocked=rows)), steps_m=[1.0])


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"nodes": [22]}, "holds 1 number; give 2 whole numbers from 2 to 10000"),
        ({"nodes": [22, 1]}, "holds 1, which is out of range"),
        ({"links": [-1]}, "holds -1, which is out of range"),
        ({"links": []}, "holds 0 numbers"),
        ({"center_m": [0, float("nan")]}, "holds nan, which is not a number; give 2 finite numbers"),
        ({"show": -1}, "study.show=-1"),
    ],
)
def test_settings_that_make_no_map_are_refused(settings, words):
    with pytest.raises(ConfigError, match=words):
        TopologicalMap(**settings)


def test_disturbances_have_no_place_here(parts):
    with pytest.raises(ConfigError, match="no queries to disturb"):
        run(replace(parts, disturbances={"any": None}))
