"""The study of pose graphs on plain back ends, the simulated walk and wrong loop closures."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from scipy import stats

from omnilab.api import Graph, Optimized, Parts, PoseGraph
from omnilab.errors import ConfigError, DataError
from omnilab.posegraph.files import g2o_text, read_graph
from omnilab.posegraph.graph import arrivals, between, check_graph, chi2, edge_chi2, is_loop, matrices, moved
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_study
from omnilab_studies import PoseGraphStudy
from omnilab_studies.pose_graph import growth
from omnilab_studies.pose_graph.figures import colors, deviations
from omnilab_studies.pose_graph.results import notes_of
from omnilab_studies.pose_graph.simulated_graphs import Walk, with_wrong_loops


@dataclass
class Lazy:
    """Leaves everything where it is, and warns of it."""

    def optimize(self, graph, covariances=False):
        value = chi2(graph)
        return Optimized(graph.poses, value, value, 0, np.ones(len(graph.edges)), warnings=["too lazy"])


@dataclass
class Knowing:
    """Knows a walk's true poses."""

    walk: Walk
    seed: int = 7

    def optimize(self, graph, covariances=False):
        _, truth = self.walk.graph(np.random.default_rng(self.seed))
        return Optimized(truth, chi2(graph), chi2(graph, truth), 1, (edge_chi2(graph, truth) < 50).astype(float))


@dataclass
class Chaining(Lazy):
    """An incremental back end that believes each guess."""

    passes: list[int] = field(default_factory=list)  # poses that each call added

    def begin(self, first_pose):
        return Chain([first_pose])

    def optimize(self, graph, covariances=False, watch=None):
        chain, warnings = self.begin(graph.poses[0]), []
        for arrival in arrivals(graph):
            own, guess = arrival.edges, moved(chain.pose(arrival.before), arrival.motion)
            failures = chain.add(guess, arrival.ends, graph.motions[own], graph.information[own])
            warnings += failures
            if watch is not None:
                watch(arrival.node, chain, failures)
        self.passes.append(len(chain.all))
        found = super().optimize(graph, covariances)
        return replace(found, warnings=[*warnings, *found.warnings])


class Chain:
    def __init__(self, poses):
        self.all = poses

    def add(self, pose, edges, motions, information):
        assert edges.max() == len(self.all)
        assert len(edges) == len(motions) == len(information) > 0
        self.all.append(pose)
        return ["not sure"] if len(self.all) == 5 else []

    def pose(self, number):
        return self.all[number]

    def poses(self):
        return np.array(self.all)


class Log(Recorder):
    def __init__(self):
        super().__init__()
        self.records = []

    def log(self, path, record, tick=None):
        self.records.append((path, record, tick))


WALK = Walk(count=80, side=6)


def ran(backend, log=None, backends=None, **settings):
    study = PoseGraphStudy(**{"walk": WALK, **settings})
    return study.run(Parts(backend=backend, backends=backends or {}), log or Log(), np.random.default_rng(7))


def metrics_of(report):
    return {metric.name: metric.value for metric in report.metrics}


def test_keeps_the_contract():
    check_study(PoseGraphStudy(walk=WALK, wrong_loops=0.2), Parts(backend=Lazy(), backends={"chaining": Chaining()}))


def test_errors_are_those_of_the_optimum():
    found = metrics_of(ran(Knowing(WALK)))
    assert found["ate"] == pytest.approx(0, abs=1e-9)
    assert found["drift"] == pytest.approx(0, abs=1e-9)
    graph, truth = WALK.graph(np.random.default_rng(7))
    assert found["chi2"] == pytest.approx(chi2(graph, truth))
    assert found["chi2_before"] == pytest.approx(chi2(graph))
    assert (found["poses"], found["edges"], found["wrong_loops"]) == (80, len(graph.edges), 0)


def test_the_truth_makes_chi2_as_large_as_the_noise():
    """Expected: the number of measured coordinates, within five standard deviations."""
    walk = Walk(count=600)
    graph, truth = walk.graph(np.random.default_rng(0))
    expected = 3 * len(graph.edges)
    assert abs(chi2(graph, truth) - expected) < 5 * np.sqrt(2 * expected)
    assert is_loop(graph).sum() > 50
    check_graph(graph)


def test_a_walk_stays_in_town_and_goes_from_crossing_to_crossing():
    _, truth = Walk(count=500, side=7).graph(np.random.default_rng(3))
    assert truth[:, :2].min() >= 0
    assert truth[:, :2].max() <= 6
    steps = between(truth, np.column_stack([np.arange(499), np.arange(1, 500)]))
    assert np.allclose(np.abs(steps[:, :2]).sum(axis=1), 1)
    assert len(np.unique(truth[:, :2], axis=0)) > 20


def test_wrong_loops_are_counted_and_rejected():
    report = ran(Knowing(WALK), backends={"lazy": Lazy()}, wrong_loops=0.5)
    found = metrics_of(report)
    assert found["knowing_rms_to_clean"] == pytest.approx(0, abs=1e-12)
    assert found["lazy_rms_to_clean"] > 0.1
    assert found["wrong_loops"] == round(0.5 * found["loops"])
    assert found["knowing_wrong_rejected"] == 1
    assert found["knowing_true_rejected"] == 0
    assert found["lazy_wrong_rejected"] == 0
    assert sum(report.tables["edges"]["wrong"]) == found["wrong_loops"]
    assert report.tables["backends"]["backend"] == ["knowing", "lazy"]


@pytest.mark.parametrize("planar", [True, False])
def test_wrong_loops_are_sound_edges_between_random_poses(planar):
    rng = np.random.default_rng(1)
    poses = rng.uniform(-3, 3, (30, 3 if planar else 7))
    if not planar:
        poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    edges = np.array([*((i, i + 1) for i in range(29)), *((i, i + 5) for i in range(20))])
    weight = np.eye(3 if planar else 6)
    graph = PoseGraph(np.arange(30), poses, edges, between(poses, edges), np.tile(weight, (len(edges), 1, 1)))
    spoilt, wrong = with_wrong_loops(graph, 0.5, np.random.default_rng(2))
    check_graph(spoilt)
    assert wrong.tolist() == list(range(49, 59))
    assert is_loop(spoilt)[wrong].all()
    assert (edge_chi2(spoilt)[wrong] > 0.1).all()
    assert np.array_equal(spoilt.edges[:49], graph.edges)
    same, none = with_wrong_loops(graph, 0, np.random.default_rng(2))
    assert len(none) == 0
    assert len(same.edges) == len(edges)


def test_loop_closures_are_painted_by_how_far_they_are_off():
    poses = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]])
    edges = np.array([[0, 1], [1, 2], [0, 2], [0, 3]])
    graph = PoseGraph(np.arange(4), poses, edges, between(poses, edges), np.tile(np.eye(3), (4, 1, 1)))
    far = replace(graph, motions=graph.motions + np.array([[0, 0, 0]] * 3 + [[0, 30, 0]]))
    assert deviations(far, poses)[3] == pytest.approx(30 / np.sqrt(3))
    paint = colors(far, poses)
    assert paint[0].tolist() == paint[1].tolist() == [108, 122, 143]
    assert paint[2, 1] > 2 * paint[2, 0]  # green
    assert paint[3, 0] > 2 * paint[3, 1]  # red


def test_a_file_is_optimised_and_comes_back_as_files(tmp_path):
    graph, truth = WALK.graph(np.random.default_rng(0))
    named = replace(graph, ids=np.arange(80) * 3)
    (tmp_path / "walk.g2o").write_text(g2o_text(named))
    (tmp_path / "truth.g2o").write_text(g2o_text(replace(named, poses=truth)))
    report = ran(Lazy(), path=str(tmp_path / "walk.g2o"), truth=str(tmp_path / "truth.g2o"))
    assert metrics_of(report)["ate"] > 0.01
    (tmp_path / "again.g2o").write_text(report.files["lazy.g2o"])
    assert np.array_equal(read_graph(tmp_path / "again.g2o").poses, graph.poses)
    rows = np.array([line.split() for line in report.files["lazy.tum"].splitlines()], float)
    assert np.allclose(rows[:, 1:4], matrices(graph.poses)[:, :3, 3])
    (tmp_path / "again.g2o").write_text(report.files["truth.g2o"])
    assert np.array_equal(read_graph(tmp_path / "again.g2o").poses, truth)
    without = ran(Lazy(), path=str(tmp_path / "walk.g2o"))
    assert "ate" not in metrics_of(without)
    (tmp_path / "truth.g2o").write_text(g2o_text(graph))
    with pytest.raises(DataError, match="other vertices"):
        ran(Lazy(), path=str(tmp_path / "walk.g2o"), truth=str(tmp_path / "truth.g2o"))


def test_warnings_of_a_back_end_are_in_the_log():
    log = Log()
    found = metrics_of(ran(Chaining(), log))
    logged = [(record.text, record.level) for path, record, _ in log.records if path == "log"]
    assert ("chaining: too lazy", "WARN") in logged
    assert logged.count(("chaining: not sure", "WARN")) == 1
    assert found["problems"] == 2


@dataclass
class Choosing(Lazy):
    """Had two starts, and keeps the better one."""

    def optimize(self, graph, covariances=False):
        weights = np.ones(len(graph.edges))
        loops = np.flatnonzero(is_loop(graph))[:3]
        weights[loops] = [0, 0.4, 0.6][: len(loops)]
        found = super().optimize(graph)
        starts = {"chordal": 41.0, "given": 770.0}
        return replace(found, weights=weights, trusted=~is_loop(graph), starts=starts, notes=["given is worse"])


def test_the_start_its_gap_and_rejected_edges_are_in_metrics_table_log_and_summary():
    log = Log()
    report = ran(Choosing(), log, {"lazy": Lazy()})
    found, table = metrics_of(report), report.tables["backends"]
    steps = WALK.count - 1
    assert table["start"] == ["chordal", ""]
    assert table["start_gap"] == [729.0, ""]
    assert table["cost_from_given"] == [770.0, ""]
    assert table["rejected"] == [2, 0]
    assert table["trusted"] == [steps, ""]
    assert found["choosing_start_gap"] == 729
    assert (found["choosing_cost_from_chordal"], found["choosing_cost_from_given"]) == (41, 770)
    assert (found["choosing_rejected"], found["choosing_trusted"]) == (2, steps)
    assert "lazy_start_gap" not in found
    assert ("choosing: given is worse", "NOTE") in [(r.text, r.level) for path, r, _ in log.records if path == "log"]
    assert "- choosing: given is worse" in report.summary
    assert found["choosing_problems"] == 1  # a note is none


def test_an_optimum_that_noise_does_not_explain_is_said():
    log = Log()
    ran(Lazy(), log)
    graph, _ = WALK.graph(np.random.default_rng(7))
    (sentence,) = [record.text for path, record, _ in log.records if path == "log" and record.level == "NOTE"]
    freedom = 3 * (len(graph.edges) - 79)
    limit = float(re.search(r"so below ([\d.]+)\)", sentence)[1])
    assert 1 <= limit / stats.chi2.ppf(1 - 1e-6, freedom) < 1.02
    assert f"more than their noise explains ({freedom} degrees of freedom, so below {limit:.6g})" in sentence
    for share, count in ((0.99, 0), (1.01, 1)):  # of the limit
        scaled = replace(graph, information=graph.information * share * limit / chi2(graph))
        assert len(notes_of(scaled, Lazy().optimize(scaled))) == count
    wrong = replace(Lazy().optimize(graph), weights=np.where(is_loop(graph), 0.4, 1.0))
    assert notes_of(graph, wrong) == []  # what is left is a tree


def test_a_growing_map_grows_in_the_logs():
    log = Log()
    report = ran(Chaining(), log, show=8)
    drawn = [(tick.step, record) for path, record, tick in log.records if path == "after/chaining"]
    stages = sorted((step, len(record.position_m)) for step, record in drawn if 0 < step < 80)
    assert len(stages) == 8
    assert all(count == step + 1 for step, count in stages)
    assert all(isinstance(record, Graph) and len(record.edges) == len(record.colors) for _, record in drawn)
    assert max(step for step, _ in drawn) == 80
    assert "growth" in report.figures


def test_an_incremental_back_end_that_nobody_can_watch_is_one_like_others():
    @dataclass
    class Unwatched(Chaining):
        def optimize(self, graph, covariances=False):
            return super().optimize(graph, covariances)

    assert metrics_of(ran(Unwatched())).keys() == metrics_of(ran(Lazy())).keys()


class Clock:
    now = 0.0

    def perf_counter(self):
        return self.now


def test_an_incremental_back_end_adds_each_pose_once_and_logs_are_not_its_time(monkeypatch):
    """Each pose takes a second to add, and each stage a hundred to draw. First comes a little graph to load libraries."""
    clock, backend, log = Clock(), Chaining(), Log()
    drawn, add = growth.drawn, Chain.add

    def later(seconds, what, *arguments):
        clock.now += seconds
        return what(*arguments)

    monkeypatch.setattr(growth, "time", clock)
    monkeypatch.setattr(growth, "drawn", lambda *arguments: later(100, drawn, *arguments))
    monkeypatch.setattr(Chain, "add", lambda *arguments: later(1, add, *arguments))
    report = ran(backend, log, show=6)
    assert backend.passes == [20, 80]
    (series,) = [record for path, record, _ in log.records if path == "time/chaining"]
    assert series.values.tolist() == [1000.0] * 79
    assert report.tables["backends"]["time_s"] == [79.0]
    done = [record.done for path, record, _ in log.records if path == "progress" and record.stage == "grow: chaining"]
    assert done == list(range(80))


def test_settings_that_cannot_be_are_one_sentence():
    for settings in ({"wrong_loops": -0.1}, {"wrong_loops": float("nan")}, {"show": 0}):
        with pytest.raises(ConfigError, match="give"):
            PoseGraphStudy(**settings)
    for settings in ({"count": 1}, {"turn_rate": 1.5}, {"sigma_m": 0.0}):
        with pytest.raises(ConfigError, match=r"study\.walk"):
            Walk(**settings)
    with pytest.raises(ConfigError, match="without a file"):
        ran(Lazy(), truth="truth.g2o")
    with pytest.raises(ConfigError, match=r"backends\.lazy has the name"):
        ran(Lazy(), backends={"lazy": Lazy()})
