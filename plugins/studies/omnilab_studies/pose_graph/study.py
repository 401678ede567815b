"""The study `pose_graph`: pose graphs optimised by one back end or by several."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from inspect import signature
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    Backend,
    Floats,
    IncrementalBackend,
    Optimized,
    Parts,
    PlaceMap,
    PoseGraph,
    Recorder,
    Report,
    Text,
    Tick,
    check_settings,
    setting,
)
from omnilab.errors import ConfigError, DataError
from omnilab.posegraph.files import read_graph
from omnilab.posegraph.graph import matrices
from omnilab.trajectory.evaluation import Alignment
from omnilab_studies.common.tables import columns_of
from omnilab_studies.pose_graph import figures
from omnilab_studies.pose_graph.growth import STEP_NS, Growth, drawn
from omnilab_studies.pose_graph.layout import layout_of
from omnilab_studies.pose_graph.results import (
    METRIC_NAMES,
    GraphTruth,
    edge_table,
    files_of,
    metrics_of,
    notes_of,
    rows_of,
    summary_of,
)
from omnilab_studies.pose_graph.simulated_graphs import Walk, with_wrong_loops


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
    metric_names: ClassVar[tuple[str, ...]] = METRIC_NAMES
    cached: ClassVar[bool] = False  # it measures time

    def __post_init__(self) -> None:
        check_settings(self, "study.")

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Take a graph, add wrong loop closures, optimise it by every back end, measure."""
        clean, true_poses = self._graph(rng, record)
        graph, wrong = with_wrong_loops(clean, self.wrong_loops, rng)
        backends = backends_of(parts)
        _show_graph(record, graph, true_poses, backends)
        optima, seconds, growth = self._optimize(backends, graph, record)
        clean_optimum = parts.backend.optimize(clean).poses if len(wrong) else None
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

    def _optimize(
        self, backends: Mapping[str, Backend], graph: PoseGraph, record: Recorder
    ) -> tuple[dict[str, Optimized], dict[str, float], dict[str, Floats]]:
        """Each back end's optimum, the seconds it took, and the times of incremental ones (see `Growth`)."""
        small, _ = Walk(count=20, side=3).graph(np.random.default_rng(0))
        optima, seconds, times_ms = dict[str, Optimized](), dict[str, float](), dict[str, Floats]()
        for name, backend in record.track(backends.items(), "optimize", len(backends), lambda _: 1):
            backend.optimize(small)  # loads its libraries before the clock starts
            record.log(f"after/{name}", drawn(graph, graph.poses), Tick(0, 0))
            with record.timed(f"optimize: {name}"):
                if isinstance(backend, IncrementalBackend) and "watch" in signature(backend.optimize).parameters:
                    growth = Growth(name, graph, record, self.show)
                    optima[name] = backend.optimize(graph, watch=growth.watch)
                    seconds[name], times_ms[name] = growth.seconds(), growth.log_times()
                else:
                    start = time.perf_counter()
                    optima[name] = backend.optimize(graph)
                    seconds[name] = time.perf_counter() - start
            _show_optimum(record, name, graph, optima[name], len(graph) if name in times_ms else 1)
        return optima, seconds, times_ms


def backends_of(parts: Parts) -> dict[str, Backend]:
    """The run's back end, under the name of its class, and those beside it."""
    own = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", type(parts.backend).__name__).lower()
    if own in parts.backends:
        raise ConfigError(f"backends.{own} has the name of the run's backend; give it another")
    return {own: parts.backend, **parts.backends}


def _show_graph(record: Recorder, graph: PoseGraph, truth: Floats | None, backends: Mapping[str, Backend]) -> None:
    """Log the graph before its optimisation."""
    record.log("", layout_of(list(backends), "start" if truth is None else "truth"))
    dots, poses = ("start", graph.poses) if truth is None else ("truth", truth)
    record.log(dots, PlaceMap(matrices(poses)[:, :3, 3]))
    record.log("before", drawn(graph, graph.poses))


def _show_optimum(record: Recorder, name: str, graph: PoseGraph, optimized: Optimized, step: int) -> None:
    """Log the graph after the optimisation, from `step` on, and what the back end says."""
    record.log(f"after/{name}", drawn(graph, optimized.poses), Tick(step, step * STEP_NS))
    fell = f"chi2 {optimized.chi2_before:.4g} before, {optimized.chi2:.4g} after {optimized.iterations} iterations"
    record.log("log", Text(f"{name}: {fell}"))
    for sentence in optimized.warnings:
        record.log("log", Text(f"{name}: {sentence}", "WARN"))
    for sentence in notes_of(graph, optimized):
        record.log("log", Text(f"{name}: {sentence}", "NOTE"))


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
