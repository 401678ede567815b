"""g2o and TORO files: exact round trips, and a sentence for everything that is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnilab.api import PoseGraph
from omnilab.errors import DataError
from omnilab.posegraph import files
from omnilab.posegraph.files import g2o_text, read_graph, toro_text
from omnilab.posegraph.graph import chi2, matrices

DATA = Path(__file__).parents[3] / "shared/data/pose_graphs"
VERTICES = "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 4 1 0 0\nVERTEX_SE2 7 1 1 1.5\n"
EDGES = "EDGE_SE2 0 4 1 0 0 1 0 0 1 0 1\nEDGE_SE2 4 7 0 1 1.5 2 0.5 0.25 3 0.125 4\n"


@pytest.fixture
def file(tmp_path):
    def write(text):
        path = tmp_path / "graph.g2o"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_what_a_g2o_file_says(file):
    graph = read_graph(file("# made by hand\n" + VERTICES + "FIX 0\n\n" + EDGES))
    assert graph.ids.tolist() == [0, 4, 7]
    assert graph.poses.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 1.5]]
    assert graph.edges.tolist() == [[0, 1], [1, 2]]
    assert graph.motions[1].tolist() == [0, 1, 1.5]
    assert graph.information[1].tolist() == [[2, 0.5, 0.25], [0.5, 3, 0.125], [0.25, 0.125, 4]]


def test_edges_of_g2o_and_toro_stand_in_one_file(file):
    lines = ["EDGE_SE2 0 1 1 0 0 10 1 2 20 3 30", "EDGE2 1 2 1 0 0 10 1 20 30 2 3", "EDGE_SE2 2 3 1 0 0 10 1 2 20 3 30"]
    graph = read_graph(file("\n".join(lines)))
    assert graph.information.tolist() == 3 * [[[10, 1, 2], [1, 20, 3], [2, 3, 30]]]


def test_toro_orders_information_otherwise(file):
    graph = read_graph(file("VERTEX2 0 0 0 0\nVERTEX2 1 1 0 0\nEQUIV 0 1\nEDGE2 0 1 1 0 0 2 0.5 3 4 0.25 0.125\n"))
    assert graph.information[0].tolist() == [[2, 0.5, 0.25], [0.5, 3, 0.125], [0.25, 0.125, 4]]


def test_edges_alone_are_chained(file):
    graph = read_graph(file(EDGES))
    assert np.allclose(graph.poses, [[0, 0, 0], [1, 0, 0], [1, 1, 1.5]])
    assert chi2(graph) < 1e-20


numbers = st.floats(-1e6, 1e6)


@given(st.lists(st.tuples(numbers, numbers, numbers), min_size=2, max_size=2), numbers, st.integers(0, 2**62))
def test_round_trips_are_exact(tmp_path_factory, poses, x, first_id):
    path = tmp_path_factory.mktemp("graphs") / "graph"
    information = np.array([[[3.1, 0.1, 0.2], [0.1, 2.2, 0.3], [0.2, 0.3, 1.3]]])
    graph = PoseGraph(np.array([first_id, first_id + 5]), np.array(poses), np.array([[1, 0]]), np.array([[x, 0.1, -4.0]]), information)  # fmt: skip
    for text in (g2o_text(graph), toro_text(graph)):
        path.write_text(text, encoding="utf-8")
        same = read_graph(path)
        for name, values in vars(graph).items():
            assert np.array_equal(getattr(same, name), values), name


def test_spatial_round_trips_are_exact(file):
    rng = np.random.default_rng(0)
    poses = rng.standard_normal((5, 7))
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    spread = rng.standard_normal((4, 6, 6))
    information = spread @ spread.transpose(0, 2, 1)
    information = (information + information.transpose(0, 2, 1)) / 2
    edges = np.array([[0, 1], [1, 2], [2, 3], [0, 4]])
    graph = PoseGraph(np.arange(5), poses, edges, poses[1:], information)
    same = read_graph(file(g2o_text(graph)))
    for name, values in vars(graph).items():
        assert np.array_equal(getattr(same, name), values), name
    with pytest.raises(DataError, match="write g2o"):
        toro_text(graph)


@pytest.mark.parametrize(
    ("name", "nodes", "edges", "before"),
    [
        ("se_sync/intel.g2o", 1728, 2512, 551.736),
        ("gtsam/w100.graph", 100, 300, 76.9527),
        ("gtsam/noisyToyGraph.txt", 4, 5, 0.783275),
        ("se_sync/manhattan.g2o", 3500, 5453, None),
        ("se_sync/tinyGrid3D.g2o", 9, 11, None),
    ],
)
def test_published_graphs_are_read(name, nodes, edges, before):
    if not (DATA / name).is_file():
        pytest.skip(f"{name}, a published graph, is not there")
    graph = read_graph(DATA / name)
    assert (len(graph), len(graph.edges)) == (nodes, edges)
    assert before is None or chi2(graph) == pytest.approx(before, rel=1e-5)


def test_gtsam_reads_the_same_spatial_graph():
    gtsam = pytest.importorskip("gtsam")
    path = DATA / "se_sync/tinyGrid3D.g2o"
    if not path.is_file():
        pytest.skip("tinyGrid3D.g2o, a published graph, is not there")
    factors, values = gtsam.readG2o(str(path), True)
    graph = read_graph(path)
    assert np.allclose(matrices(graph.poses), [values.atPose3(i).matrix() for i in range(9)])
    for factor, motion, W in zip(map(factors.at, range(11)), matrices(graph.motions), graph.information, strict=True):
        assert np.allclose(factor.measured().matrix(), motion)
        theirs = factor.noiseModel().information()[[3, 4, 5, 0, 1, 2]][:, [3, 4, 5, 0, 1, 2]]  # rotation first
        assert np.allclose(theirs, W)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (VERTICES + EDGES + "EDGE_SE4 0 1", r"line 6 .*'EDGE_SE4' \(did you mean EDGE_SE2\?\); known are"),
        (VERTICES + EDGES.replace("1.5", "nan"), "line 5 .*NaN or infinity"),
        (VERTICES + EDGES.replace("1.5", "1e999"), "line 5 .*NaN or infinity"),
        (VERTICES + EDGES.replace("1.5", "fast"), "line 5 .*no number.*fast"),
        (VERTICES + EDGES.replace("0 4 1", "0 4.5 1"), "line 4 .*no number"),
        (VERTICES.replace("VERTEX_SE2 0", "VERTEX_SE2 -3") + EDGES, "line 1 .*id -3"),
        (VERTICES + EDGES.replace("0.125 4", "0.125"), "line 5 .*has 10 values after EDGE_SE2; write 11"),
        (VERTICES + "VERTEX_SE2 4 0 0 0\n" + EDGES, "line 4 .*vertex 4 a second time"),
        (VERTICES + EDGES.replace("4 7", "4 8"), "line 5 .*vertex 8, which the file does not place"),
        (VERTICES + EDGES.splitlines()[0], "2 parts"),
        (VERTICES + EDGES.replace("0.125 4", "0.125 -4"), "edge 4 7 is not positive definite"),
        (VERTICES, "no edge"),
        ("", "no edge"),
        (VERTICES + EDGES + "VERTEX_SE3:QUAT 9 0 0 0 0 0 0 1", "line 6 .*VERTEX_SE3:QUAT in a planar graph"),
        ("FIX 0\nFIX 4\n" + VERTICES + EDGES, "line 2 .*fixes a second vertex"),
        (VERTICES + "EDGE_SE2 " + "1 " * 1500, "beyond"),
        ("EDGE_SE3:QUAT 0 1 0 0 0 0 0 0 2" + " 1" * 21, "length 2"),
    ],
)
def test_files_that_cannot_be_used_are_one_sentence(file, text, reason):
    with pytest.raises(DataError, match=reason):
        read_graph(file(text))


def test_files_of_the_wrong_kind_are_one_sentence(tmp_path, monkeypatch):
    with pytest.raises(DataError, match="cannot be read"):
        read_graph(tmp_path / "nowhere.g2o")
    (tmp_path / "binary.g2o").write_bytes(bytes(range(256)))
    with pytest.raises(DataError, match="is a binary file, no pose graph; give a g2o or TORO file"):
        read_graph(tmp_path / "binary.g2o")
    (tmp_path / "log.mcap").write_bytes(b"\x89MCAP0\r\n" + bytes(9))
    with pytest.raises(DataError, match="is an MCAP log, no pose graph; give a g2o or TORO file"):
        read_graph(tmp_path / "log.mcap")
    (tmp_path / "latin.g2o").write_bytes(b"# caf\xe9\n" + EDGES.encode())
    with pytest.raises(DataError, match="is no text"):
        read_graph(tmp_path / "latin.g2o")
    monkeypatch.setattr(files, "MOST_BYTES", 10)
    with pytest.raises(DataError, match="more than 10"):
        read_graph(tmp_path / "latin.g2o")
