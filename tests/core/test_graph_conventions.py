"""Graph files in other conventions: several robots, FIX, priors and landmarks, degrees, orders of numbers, repetitions."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from omnilab.api import PoseGraph
from omnilab.errors import DataError
from omnilab.posegraph.files import g2o_text, read_graph, toro_text
from omnilab.posegraph.graph import between, chi2, dead_reckoning, is_loop, matrices, vectors

PUBLISHED = Path(__file__).parents[3] / "shared/data/pose_graphs"
THREE = """VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0 0
VERTEX_SE2 2 2 0 0
EDGE_SE2 0 1 1 0 0 100 0 0 100 0 100
EDGE_SE2 1 2 1 0.1 0 100 0 0 100 0 100
EDGE_SE2 0 2 1 0 0 100 0 0 100 0 100
"""


@pytest.fixture
def read(tmp_path):
    def of(text, notes=None):
        path = tmp_path / "graph.g2o"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_graph(path, notes)

    return of


def refused(read, text):
    with pytest.raises(DataError) as caught:
        read(text)
    return str(caught.value)


def loops_of(text_ids, pairs):
    """is_loop of edges between the ids given."""
    ids = np.array(sorted(text_ids))
    edges = np.searchsorted(ids, np.array(pairs))
    poses = np.column_stack([np.arange(len(ids)), np.zeros((len(ids), 2))])
    return is_loop(PoseGraph(ids, poses, edges, between(poses, edges), np.tile(np.eye(3), (len(edges), 1, 1)))).tolist()


def around(planar=True, count=20, laps=2, noise=0.0, seed=0):
    """Laps around a circle with loop closures to the lap before, poses as measured; and the true poses."""
    rng, angle = np.random.default_rng(seed), np.linspace(0, 2 * np.pi * laps, count)
    T = np.tile(np.eye(4), (count, 1, 1))
    tilt = np.zeros(count) if planar else 0.4 * np.sin(2 * angle)
    T[:, :3, :3] = Rotation.from_euler("zy", np.column_stack([angle + np.pi / 2, tilt])).as_matrix()
    T[:, :2, 3] = 5 * np.column_stack([np.cos(angle), np.sin(angle)])
    half = count // laps
    pairs = [(i, i + 1) for i in range(count - 1)] + [(i, i + half) for i in range(0, count - half, 2)]
    truth, edges, d = vectors(T, planar), np.array(pairs), 3 if planar else 6
    motions = between(truth, edges)
    motions[:, : 3 if planar else 2] += noise * rng.standard_normal((len(edges), 3 if planar else 2))
    return PoseGraph(np.arange(count), truth, edges, motions, np.tile(100 * np.eye(d), (len(edges), 1, 1))), truth


# --------------------------------------------------------------------------------------------------------- robots
A, B = ord("a") << 56, ord("b") << 56  # GTSAM's symbol('a', 0), symbol('b', 0)


@pytest.mark.parametrize(
    ("ids", "pair", "loop"),
    [
        (range(9), (3, 4), False),
        (range(9), (4, 3), False),
        (range(9), (3, 5), True),
        ([*range(5), *range(100, 105)], (4, 100), True),  # adjacent rows of two robots
        ([*range(5), *range(100, 105)], (100, 101), False),
        ([*range(5), *range(1000, 1005), *range(2000, 2005)], (1004, 2000), True),
        ([*(A + np.arange(5)), *(B + np.arange(5))], (A + 4, B), True),
        ([*(A + np.arange(5)), *(B + np.arange(5))], (B, B + 1), False),
        ([A, B, B + 1], (A, B), True),
        (range(0, 90, 10), (30, 40), False),  # keyframes
        ([*range(0, 90, 10), *range(1000, 1090, 10)], (80, 1000), True),
        ([0, 4, 7, 12, 15, 19], (7, 12), False),
        ([*range(5), *range(6, 12)], (4, 6), False),  # a pose that was left out
        ([3, 9], (3, 9), False),
    ],
)
def test_odometry_joins_consecutive_ids_of_one_robot(ids, pair, loop):
    assert loops_of(list(ids), [pair]) == [loop]


@given(st.integers(2, 30), st.integers(2, 30), st.integers(3, 2**40))
def test_the_last_pose_of_one_robot_and_the_first_of_the_next_are_no_odometry(first, second, gap):
    ids = [*range(first), *range(first - 1 + gap, first - 1 + gap + second)]
    pairs = list(pairwise(ids))
    assert loops_of(ids, pairs) == [i == first - 1 for i in range(len(pairs))]


def test_two_robots_are_chained_each_along_its_own_odometry(read):
    """The second is seen by the first from pose 1; a wrong edge joins the last of the one to the first of the other."""
    lines = [f"EDGE_SE2 {i} {i + 1} 1 0 0 9 0 0 9 0 9" for i in (0, 1, 50, 51)]
    lines += ["EDGE_SE2 1 50 0 3 0 9 0 0 9 0 9", "EDGE_SE2 2 50 70 70 3 9 0 0 9 0 9"]
    graph = read("\n".join(lines))
    assert is_loop(graph).tolist() == [False] * 4 + [True] * 2
    assert np.allclose(graph.poses[:3], [[0, 0, 0], [1, 0, 0], [2, 0, 0]])
    steps = between(graph.poses, np.array([[3, 4], [4, 5]]))
    assert np.allclose(steps, [[1, 0, 0]] * 2)


# ------------------------------------------------------------------------------------------------------------- FIX
@pytest.mark.parametrize("lines", ["FIX 0 2\n", "FIX 0\nFIX 2\n", "FIX 2 0 1\n", "FIX 1\n# and\nFIX 0\n"])
def test_a_second_fixed_vertex_is_refused_and_the_advice_works(read, lines):
    assert "fixes a second vertex" in refused(read, THREE + lines)
    assert "leave one id" in refused(read, lines + THREE)
    assert len(read(THREE + "FIX 0\n")) == 3


@pytest.mark.parametrize("lines", ["FIX 0\n", "FIX 0 0\n", "FIX 0\nFIX 0\n", ""])
def test_the_first_vertex_stays_anyway(read, lines):
    notes = []
    read(THREE + lines, notes)
    assert notes == []


def test_another_vertex_that_is_fixed_is_not_and_said(read):
    notes = []
    read(THREE + "FIX 2\n", notes)
    assert len(notes) == 1
    assert "FIX 2 is not followed: the first vertex, 0, stays" in notes[0]


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("FIX 9", "line 7 .* fixes vertex 9, which"),
        ("FIX", "fixes no vertex"),
        ("FIX first", "no id where one belongs"),
    ],
)
def test_fix_lines_of_nothing_are_one_sentence(read, line, reason):
    with pytest.raises(DataError, match=reason):
        read(THREE + line)


# --------------------------------------------------------------------------------------- what is not read, by its name
@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("EDGE_SE2_PRIOR 0 0 0 0 1 0 0 1 0 1", "a prior on a vertex"),
        ("EDGE_PRIOR_SE2 0 0 0 0 1 0 0 1 0 1", "a prior on a vertex"),
        ("EDGE_SE3_PRIOR 0 0 0 0 0 0 0 0 1" + " 1" * 21, "a prior on a vertex"),
        ("EDGE_PRIOR_SE2_XY 0 1 2 1 0 1", "a prior on a vertex"),
        ("VERTEX_XY 7 1 2", "about landmarks"),
        ("EDGE_SE2_XY 0 7 1 2 1 0 1", "about landmarks"),
        ("EDGE_BEARING_SE2_XY 0 7 1 1", "about landmarks"),
        ("VERTEX_TRACKXYZ 7 1 2 3", "about landmarks"),
        ("EDGE_SE3_TRACKXYZ 0 7 0 1 2 3 1 0 0 1 0 1", "about landmarks"),
        ("LANDMARK 0 7 1 2 1 0 1", "about landmarks"),
        ("BR 0 7 1 2 1 1", "about landmarks"),
        ("PARAMS_SE3OFFSET 0 0 0 0 0 0 0 1", "a sensor's place on the robot"),
        ("PARAMS_SE2OFFSET 0 0 0 0", "a sensor's place on the robot"),
        ("PARAMS_CAMERACALIB 0 0 0 0 0 0 0 1 500 500 320 240", "a sensor's place on the robot"),
        ("EDGE_SE2_SWITCHABLE 0 1 2 1 0 0 1 0 0 1 0 1", "switchable"),
        ("VERTEX_SWITCH 2 1", "switchable"),
        ("EDGE_SE2_MAXMIX 0 1", "switchable"),
        ("VERTEX3 0 0 0 0 0 0 0", "Euler angles"),
        ("EDGE3 0 1 1 0 0 0 0 0" + " 1" * 21, "Euler angles"),
        ("EDGE_SIM3:QUAT 0 1 1 0 0 0 0 0 1 1", "a similarity"),
        ("ROBOTLASER1 0 -1.5 3.1 0.01 30 0.1 0 " + "1.0 " * 1000, "a laser scan"),
    ],
)
def test_priors_landmarks_parameters_and_their_kin_are_refused_by_name_and_the_advice_works(read, line, reason):
    said = refused(read, THREE + line + "\n")
    assert "line 7 of" in said
    assert f"is {line.split()[0]}, " in said
    assert reason in said
    assert len(read(THREE)) == 3  # without the line


def test_a_word_in_small_letters_is_known_by_its_large_ones(read):
    assert "did you mean VERTEX_SE2?" in refused(read, THREE.lower())


def test_equiv_lines_that_are_left_out_are_counted(read):
    notes = []
    read("VERTEX2 0 0 0 0\nVERTEX2 1 1 0 0\nEQUIV 0 1\nEDGE2 0 1 1 0 0 2 0 3 4 0 0\nEQUIV 1 0\n", notes)
    assert ["2 EQUIV lines are left out" in sentence for sentence in notes] == [True]


def test_a_byte_order_mark_and_other_line_ends_are_read(read):
    assert np.array_equal(read(b"\xef\xbb\xbf" + THREE.replace("\n", "\r\n").encode()).poses, read(THREE).poses)


# ----------------------------------------------------------------------------------------------------- repetitions
def test_edges_that_stand_twice_are_counted_and_said(read):
    notes, edge = [], THREE.splitlines()[4]
    once, twice = read(THREE), read(THREE + edge.replace("0.1", "0.10") + "\n", notes)
    assert chi2(twice) == pytest.approx(chi2(once) + 100 * 0.1**2)
    assert len(notes) == 1
    assert "1 of 4 edges" in notes[0]
    assert "line 7 repeats line 5" in notes[0]
    notes.clear()
    read(THREE + edge.replace("0.1", "0.2") + "\n", notes)  # another measurement between the same vertices
    assert notes == []


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (THREE + "VERTEX_SE2 2 2 0 0\n", "line 7 .*vertex 2 a second time"),
        (THREE + "EDGE_SE2 1 1 0 0 0 1 0 0 1 0 1\n", "from vertex 1 to itself; remove it"),
        (THREE + "VERTEX_SE2 8 2 0 0\n", "2 parts, with no edge between vertex 0 and vertex 8"),
    ],
)
def test_what_joins_nothing_or_stands_twice_is_one_sentence(read, text, reason):
    with pytest.raises(DataError, match=reason):
        read(text)


# --------------------------------------------------------------------------------------------------------- degrees
def in_degrees(rows):
    return rows * [1, 1, 180 / np.pi]


@pytest.mark.parametrize(
    ("vertices", "edges", "parts"),
    [(True, True, "vertices and edges"), (True, False, "vertices"), (False, True, "edges")],
)
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_headings_in_degrees_are_noticed(read, vertices, edges, parts, noise):
    graph, _ = around(noise=noise)
    written = replace(
        graph,
        poses=in_degrees(graph.poses) if vertices else graph.poses,
        motions=in_degrees(graph.motions) if edges else graph.motions,
    )
    said = refused(read, g2o_text(written))
    assert "multiply" in said or "multiplied" in said
    assert "degrees" in said
    if not edges:
        assert f"those of {parts} fit as degrees" in said
    assert np.allclose(read(g2o_text(graph)).poses, graph.poses)  # as the sentence says


def test_degrees_of_a_robot_that_turns_little_are_noticed_by_its_loop_closures(read):
    """Two degrees a step, four poses that see the other side: no step is beyond a full turn in radians."""
    graph, _ = around(count=360)
    loops = is_loop(graph)
    assert np.abs(in_degrees(graph.motions)[~loops, 2]).max() < 6.5
    across = replace(
        graph,
        edges=np.concatenate([graph.edges[~loops], [[0, 90], [30, 120], [60, 150], [90, 180]]]),
        information=graph.information[: (~loops).sum() + 4],
    )
    across = replace(across, motions=in_degrees(between(graph.poses, across.edges)))
    assert "those of edges fit as degrees" in refused(read, g2o_text(across))
    without = "\n".join(line for line in g2o_text(across).splitlines() if not line.startswith("VERTEX"))
    assert "those of edges fit as degrees" in refused(read, without)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32), st.floats(0, 0.5), st.booleans(), st.booleans())
def test_radians_that_wind_up_are_no_degrees(tmp_path_factory, seed, noise, placed, wound):
    """Headings that were never wrapped, noise, bad first poses: nothing false is said."""
    graph, truth = around(count=60, laps=5, noise=noise, seed=seed)
    poses = truth.copy()
    poses[:, 2] = np.unwrap(poses[:, 2]) if wound else poses[:, 2]
    written = replace(graph, poses=poses)
    if wound:
        motions = graph.motions.copy()
        motions[is_loop(graph), 2] += 2 * np.pi
        written = replace(written, motions=motions)
    if seed % 3 == 0:
        written = replace(written, poses=dead_reckoning(written))
    lines = g2o_text(written).splitlines()
    path = tmp_path_factory.mktemp("graphs") / "graph.g2o"
    path.write_text("\n".join(line for line in lines if placed or not line.startswith("VERTEX")))
    assert len(read_graph(path)) == 60


# ---------------------------------------------------------------------------------------------------- orders of numbers
@pytest.mark.parametrize("placed", [True, False])
@pytest.mark.parametrize("parts", ["vertices", "edges", "vertices and edges"])
def test_quaternions_with_w_first_are_noticed(read, placed, parts):
    graph, _ = around(planar=False)
    if not placed and parts != "edges":
        parts = "edges"
    first = [0, 1, 2, 6, 3, 4, 5]
    written = replace(
        graph,
        poses=graph.poses[:, first] if "vertices" in parts else graph.poses,
        motions=graph.motions[:, first] if "edges" in parts else graph.motions,
    )
    lines = g2o_text(written).splitlines()
    said = refused(read, "\n".join(line for line in lines if placed or not line.startswith("VERTEX")))
    assert f"quaternions of {parts} that fit as qw qx qy qz" in said
    assert np.allclose(matrices(read(g2o_text(graph)).poses), matrices(graph.poses))


def test_information_in_the_order_of_toro_under_a_word_of_g2o_is_noticed_and_the_other_way_round(read):
    graph, _ = around()
    W = np.tile(np.array([[4.0, 1, 0.5], [1, 3, 0.2], [0.5, 0.2, 90]]), (len(graph.edges), 1, 1))
    graph = replace(graph, information=W)
    toro = toro_text(graph)
    said = refused(read, toro.replace("VERTEX2", "VERTEX_SE2").replace("EDGE2", "EDGE_SE2"))
    assert "positive definite as TORO's xx xy yy hh xh yh, and not as the upper triangle" in said
    assert "or EDGE2 for these edges" in said
    assert np.array_equal(read(toro).information, W)  # the advice
    said = refused(read, g2o_text(graph).replace("VERTEX_SE2", "VERTEX2").replace("EDGE_SE2", "EDGE2"))
    assert "or EDGE_SE2 for these edges" in said


def test_a_lower_triangle_is_noticed(read):
    for planar in (True, False):
        graph, _ = around(planar=planar)
        d = 3 if planar else 6
        W = np.tile(np.diag(np.arange(1.0, d + 1)), (len(graph.edges), 1, 1))
        rows, columns = np.tril_indices(d)
        kind = "SE2" if planar else "SE3:QUAT"
        lines = g2o_text(replace(graph, information=W)).splitlines()
        numbers = " ".join(map(str, W[0][rows, columns]))
        ends = 2 + graph.motions.shape[1] + 1
        lower = [" ".join([*x.split()[:ends], numbers]) if x.startswith("EDGE") else x for x in lines]
        said = refused(read, "\n".join(lower))
        assert "positive definite as the lower triangle, row by row, and not as the upper triangle" in said, kind


@pytest.mark.parametrize(
    ("numbers", "reason"),
    [
        ("0 0 0 0 0 0", "edge 1 2 is zero: it measured nothing; leave the edge out"),
        ("100 0 0 100 0 0", "edge 1 2 is not positive definite"),
        ("100 0 0 -100 0 100", "edge 1 2 is not positive definite"),
        ("100 0 0 0 100 0 0 0 100", "has 14 values after EDGE_SE2; write 11: 2 ids, 3 of the motion, 6 of"),
    ],
)
def test_information_that_is_none_is_one_sentence(read, numbers, reason):
    with pytest.raises(DataError, match=reason):
        read(THREE.replace("1 0.1 0 100 0 0 100 0 100", f"1 0.1 0 {numbers}"))


@pytest.mark.parametrize("name", ["intel.g2o", "CSAIL.g2o", "manhattan.g2o", "tinyGrid3D.g2o", "smallGrid3D.g2o"])
def test_nothing_false_is_said_of_published_graphs(name):
    if not (PUBLISHED / "se_sync" / name).is_file():
        pytest.skip(f"{name}, a published graph, is not there")
    notes = []
    graph = read_graph(PUBLISHED / "se_sync" / name, notes)
    assert notes == [] or (name == "CSAIL.g2o" and "(line 1139 repeats line 1138)" in notes[0])  # it does
    assert np.array_equal(is_loop(graph), np.abs(np.diff(graph.edges, axis=1)[:, 0]) != 1)
