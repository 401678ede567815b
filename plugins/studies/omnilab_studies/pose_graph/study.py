"""The study `pose_graph`: pose graphs optimised by one back end or by several."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    Backend,
    Floats,
    Graph,
    IncrementalBackend,
    IncrementalGraph,
    Optimized,
    Parts,
    PlaceMap,
    PoseGraph,
    Recorder,
    Report,
    Series,
    Text,
    Tick,
    check_settings,
    setting,
)
from omnilab.errors import ConfigError, DataError
from omnilab.posegraph.files import read_graph
from omnilab.posegraph.graph import arrivals, matrices, moved
from omnilab.trajectory.evaluation import Alignment
from omnilab_studies.common.tables import columns_of
from omnilab_studies.pose_graph import figures
from omnilab_studies.pose_graph.layout import layout_of
from omnilab_studies.pose_graph.results import (
    GraphTruth,
    edge_table,
    files_of,
    metrics_of,
    rows_of,
    summary_of,
)
from omnilab_studies.pose_graph.simulated_graphs import Walk, with_wrong_loops

STEP_NS = 100_000_000  # between two poses, in the logs


@dataclass
class PoseGraphStudy:
    """A pose graph before and after its optimisation, by one back end or by several side by side.

    The graph is a file's, or that of a simulated walk. A share of wrong loop closures can be added: then each optimum is
    also measured against the one that the run's `backend` finds without them (`rms_to_clean`, nothing aligned: the
    first pose is the same). Where the true poses are known, errors are those of `omnilab.trajectory.evaluation`. Incremental
    back ends are also run pose by pose. The run's folder gets each optimum as NAME.g2o and
    NAME.tum, a second a pose; also the truth.
    """

    path: str | None = None  # g2o or TORO; null: the simulated walk
    truth: str | None = None  # a graph file with the true poses; null: not known, but for a simulated walk
    walk: Walk = field(default_factory=Walk)  # where there is no file
    wrong_loops: float = setting(0.0, at_least=0, at_most=10)  # added, as a share of the graph's own loop closures
    alignment: Alignment = Alignment.se3  # with the truth: none, first, se2, se3, sim2 or sim3
    show: int = setting(30, at_least=1)  # stages of a growing map that go into the logs

    needs: ClassVar[tuple[str, ...]] = ("backend",)
    cached: ClassVar[bool] = False  # it measures time

    def __post_init__(self) -> None:
        check_settings(self, "study.")

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Take a graph, add wrong loop closures, optimise it by every back end, measure."""
        clean, true_poses = self._graph(rng, record)
        graph, wrong = with_wrong_loops(clean, self.wrong_loops, rng)
        backends = backends_of(parts)
        _show_graph(record, graph, true_poses, backends)
        optima, seconds = _optimize(backends, graph, record)
        clean_optimum = parts.backend.optimize(clean).poses if len(wrong) else None
        growth = {
            name: self._add_poses(backend, graph, name, record)
            for name, backend in backends.items()
            if isinstance(backend, IncrementalBackend)
        }
        return _report(graph, GraphTruth(wrong, true_poses, clean_optimum, self.alignment), optima, seconds, growth)

    def _graph(self, rng: np.random.Generator, record: Recorder) -> tuple[PoseGraph, Floats | None]:
        """The graph of the file or of the walk, and the true poses (N, k) where they are known."""
        if self.path is None:
            if self.truth is not None:
                raise ConfigError(f"study.truth={self.truth} is of no use without a file; give study.path=FILE, too")
            return self.walk.graph(rng)
        notes: list[str] = []
        graph = read_graph(Path(self.path), notes)
        for sentence in notes:
            record.log("log", Text(sentence, "NOTE"))
        if self.truth is None:
            return graph, None
        true = read_graph(Path(self.truth))
        if true.planar != graph.planar or not np.array_equal(true.ids, graph.ids):
            raise DataError(f"{self.truth} has other vertices than {self.path}; give the true poses of the same ones")
        return graph, true.poses

    def _add_poses(self, backend: IncrementalBackend, graph: PoseGraph, name: str, record: Recorder) -> Floats:
        """Build the graph pose by pose: milliseconds (N - 1,) that each took to add. Some stages go into the logs."""
        incremental, nodes, times = backend.begin(graph.poses[0]), [0], []
        stages = set(np.linspace(1, len(graph) - 1, self.show).astype(int).tolist())
        for arrival in record.track(arrivals(graph), f"grow: {name}", len(graph) - 1, lambda _: 1):
            own = arrival.edges
            start = time.perf_counter()
            guess = moved(incremental.pose(arrival.before), arrival.motion)
            warnings = incremental.add(guess, arrival.ends, graph.motions[own], graph.information[own])
            times.append(1e3 * (time.perf_counter() - start))
            nodes.append(arrival.node)
            step = len(nodes) - 1
            for sentence in warnings:
                record.log("log", Text(f"{name}: {sentence}", "WARN"), Tick(step, step * STEP_NS))
            if step in stages:
                stage = _drawn(*_subgraph(graph, incremental, nodes))
                record.log(f"after/{name}", stage, Tick(step, step * STEP_NS))
        steps = np.arange(1, len(graph))
        record.log(f"time/{name}", Series(np.array(times), steps, steps * STEP_NS, "ms"))
        return np.array(times)


def backends_of(parts: Parts) -> dict[str, Backend]:
    """The run's back end, under the name of its class, and those beside it."""
    own = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", type(parts.backend).__name__).lower()
    if own in parts.backends:
        raise ConfigError(f"backends.{own} has the name of the run's backend; give it another")
    return {own: parts.backend, **parts.backends}


def _optimize(
    backends: Mapping[str, Backend], graph: PoseGraph, record: Recorder
) -> tuple[dict[str, Optimized], dict[str, float]]:
    """Each back end's optimum, and the seconds it took."""
    small, _ = Walk(count=20, side=3).graph(np.random.default_rng(0))
    optima: dict[str, Optimized] = {}
    seconds: dict[str, float] = {}
    for name, backend in record.track(backends.items(), "optimize", len(backends), lambda _: 1):
        backend.optimize(small)  # loads its libraries before the clock starts
        with record.timed(f"optimize: {name}"):
            start = time.perf_counter()
            optima[name] = backend.optimize(graph)
            seconds[name] = time.perf_counter() - start
        _show_optimum(record, name, graph, optima[name], len(graph) if isinstance(backend, IncrementalBackend) else 1)
    return optima, seconds


def _show_graph(record: Recorder, graph: PoseGraph, truth: Floats | None, backends: Mapping[str, Backend]) -> None:
    """Log the graph before its optimisation."""
    record.log("", layout_of(list(backends), "start" if truth is None else "truth"))
    record.log("start", PlaceMap(matrices(graph.poses)[:, :3, 3]))
    if truth is not None:
        record.log("truth", PlaceMap(matrices(truth)[:, :3, 3]))
    record.log("before", _drawn(graph, graph.poses))


def _show_optimum(record: Recorder, name: str, graph: PoseGraph, optimized: Optimized, step: int) -> None:
    """Log the graph before the optimisation at step 0, after it from `step` on, and what the back end says."""
    record.log(f"after/{name}", _drawn(graph, graph.poses), Tick(0, 0))
    record.log(f"after/{name}", _drawn(graph, optimized.poses), Tick(step, step * STEP_NS))
    for sentence in optimized.warnings:
        record.log("log", Text(f"{name}: {sentence}", "WARN"))
    for sentence in optimized.notes:
        record.log("log", Text(f"{name}: {sentence}", "NOTE"))


def _drawn(graph: PoseGraph, poses: Floats) -> Graph:
    return Graph(matrices(poses)[:, :3, 3], graph.edges, figures.colors(graph, poses))


def _subgraph(graph: PoseGraph, incremental: IncrementalGraph, nodes: list[int]) -> tuple[PoseGraph, Floats]:
    """The part of a graph among the nodes that were added, and its poses."""
    number = np.full(len(graph), -1)
    number[nodes] = np.arange(len(nodes))
    edges = number[graph.edges]
    there = (edges >= 0).all(axis=1)
    poses = incremental.poses()
    part = replace(
        graph, ids=graph.ids[nodes], poses=poses, edges=edges[there],
        motions=graph.motions[there], information=graph.information[there],
    )  # fmt: skip
    return part, poses


def _report(
    graph: PoseGraph, truth: GraphTruth, optima: Mapping[str, Optimized],
    seconds: Mapping[str, float], growth: Mapping[str, Floats],
) -> Report:  # fmt: skip
    rows = rows_of(graph, optima, truth, seconds)
    poses = {name: one.poses for name, one in optima.items()}
    drawn: dict[str, Any] = {
        "graphs": figures.graphs(graph, {"before": graph.poses, **poses}, truth.poses, truth.wrong)
    }
    if growth:
        drawn["growth"] = figures.growth(growth)
    return Report(
        metrics_of(graph, rows, truth.wrong),
        {"backends": columns_of(rows), "edges": edge_table(graph, optima, truth.wrong)},
        drawn,
        files=files_of(graph, poses if truth.poses is None else {"truth": truth.poses, **poses}),
        summary=summary_of(graph, rows, truth.wrong, optima),
    )
