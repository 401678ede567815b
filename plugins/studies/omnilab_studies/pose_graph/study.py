"""Pose graphs, optimised by one back end or by several."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping, Sequence
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
    Ints,
    Metric,
    Optimized,
    Panel,
    Parts,
    PlaceMap,
    PoseGraph,
    Recorder,
    Report,
    Series,
    Text,
    Tick,
    ViewLayout,
)
from omnilab.errors import ConfigError, DataError
from omnilab.posegraph.files import g2o_text, read_graph
from omnilab.posegraph.graph import arrivals, is_loop, matrices, moved
from omnilab.trajectory.evaluation import Alignment, evaluate, rms
from omnilab.trajectory.files import tum_text
from omnilab_studies.common.tables import markdown
from omnilab_studies.pose_graph import figures
from omnilab_studies.pose_graph.simulated_graphs import Walk, with_wrong_loops

STEP_NS = 100_000_000  # between two poses, in the logs
TOLD = (
    "rms_to_clean_m",
    "ate_m",
    "chi2",
    "chi2_before",
    "wrong_rejected",
    "true_rejected",
    "rpe_metre_m",
    "drift",
    "scale",
    "iterations",
    "problems",
)  # which columns of the table are metrics, the telling ones first
SHOWN = {"backend", "rms_to_clean_m", "ate_m", "chi2", "wrong_rejected", "time_s"}  # and which are in the viewer
REJECTED = 0.5  # an edge that counts less than this is


@dataclass
class PoseGraphStudy:
    """A pose graph before and after its optimisation, by one back end or by several side by side.

    The graph is a file's, or that of a simulated walk. A share of wrong loop closures can be added: then each answer is
    also measured against the optimum that the run's `backend` finds without them (`rms_to_clean`, nothing aligned: the
    first pose is the same). Where the true poses are known, errors are those of `omnilab.trajectory.evaluation`. Back ends that
    take poses as they come are also shown at that, pose by pose. The run's folder gets each optimum as NAME.g2o and
    NAME.tum, a second a pose; also the truth.
    """

    path: str | None = None  # g2o or TORO; null: the simulated walk
    truth: str | None = None  # a graph file with the true poses; null: not known, but for a simulated walk
    walk: Walk = field(default_factory=Walk)  # where there is no file
    wrong_loops: float = 0.0  # added, as a share of the graph's own loop closures
    alignment: Alignment = Alignment.se3  # with the truth: none, first, se2, se3, sim2 or sim3
    show: int = 30  # stages of a growing map that go into the logs

    needs: ClassVar[tuple[str, ...]] = ("backend",)
    cached: ClassVar[bool] = False  # it measures time

    def __post_init__(self) -> None:
        if not 0 <= self.wrong_loops <= 10:
            raise ConfigError(f"study.wrong_loops={self.wrong_loops} is no share; give a number from 0 to 10")
        if self.show < 1:
            raise ConfigError(f"study.show={self.show} shows nothing; give 1 or more")

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Take a graph, spoil it, optimise it, measure."""
        clean, truth = self._graph(rng)
        graph, wrong = with_wrong_loops(clean, self.wrong_loops, rng)
        rivals = rivals_of(parts)
        record.log("", _layout(list(rivals), "start" if truth is None else "truth"))
        record.log("start", PlaceMap(matrices(graph.poses)[:, :3, 3]))
        if truth is not None:
            record.log("truth", PlaceMap(matrices(truth)[:, :3, 3]))
        record.log("before", _drawn(graph, graph.poses))

        small, _ = Walk(count=20, side=3).graph(np.random.default_rng(0))

        # each back end, and for comparison the optimum without wrong loops
        found: dict[str, Optimized] = {}
        seconds: dict[str, float] = {}
        for name, backend in record.track(rivals.items(), "optimize", len(rivals), lambda _: 1):
            backend.optimize(small)  # loads its libraries before the clock starts
            with record.timed(f"optimize: {name}"):
                start = time.perf_counter()
                found[name] = backend.optimize(graph)
                seconds[name] = time.perf_counter() - start
            self._tell(record, name, graph, found[name], len(graph) if isinstance(backend, IncrementalBackend) else 1)
        optimum = parts.backend.optimize(clean).poses if len(wrong) else None

        # back ends that take poses as they come, at that
        growth = {
            name: self._grow(backend, graph, name, record)
            for name, backend in rivals.items()
            if isinstance(backend, IncrementalBackend)
        }

        # what it amounts to
        rows = [
            {
                "backend": name,
                **_row(graph, one, wrong),
                **self._errors(one.poses, truth, optimum),
                "time_s": seconds[name],
            }
            for name, one in found.items()
        ]
        record.log("summary", Text(_summary(graph, rows, wrong), markdown=True))
        tables = {"backends": _columns(rows), "edges": _edge_table(graph, found, wrong)}
        optima = {name: one.poses for name, one in found.items()}
        shown = {"before": graph.poses, **optima}
        drawn: dict[str, Any] = {"graphs": figures.graphs(graph, shown, truth, wrong)}
        if growth:
            drawn["growth"] = figures.growth(growth)
        known = optima if truth is None else {"truth": truth, **optima}
        files = {f"{name}.{kind}": text for name, at in known.items() for kind, text in _texts(graph, at).items()}
        return Report(_metrics(graph, rows, wrong), tables, drawn, files=files)

    def _graph(self, rng: np.random.Generator) -> tuple[PoseGraph, Floats | None]:
        """The graph as it is, and the true poses (N, k) where they are known."""
        if self.path is None:
            if self.truth is not None:
                raise ConfigError(f"study.truth={self.truth} is of no use without a file; give study.path=FILE, too")
            return self.walk.graph(rng)
        graph = read_graph(Path(self.path))
        if self.truth is None:
            return graph, None
        true = read_graph(Path(self.truth))
        if true.planar != graph.planar or not np.array_equal(true.ids, graph.ids):
            raise DataError(f"{self.truth} has other vertices than {self.path}; give the true poses of the same ones")
        return graph, true.poses

    def _tell(self, record: Recorder, name: str, graph: PoseGraph, found: Optimized, step: int) -> None:
        """An optimum in the logs: at first the graph as it was, from a step on as it is."""
        record.log(f"after/{name}", _drawn(graph, graph.poses), Tick(0, 0))
        record.log(f"after/{name}", _drawn(graph, found.poses), Tick(step, step * STEP_NS))
        for sentence in found.warnings:
            record.log("log", Text(f"{name}: {sentence}", "WARN"))

    def _grow(self, backend: IncrementalBackend, graph: PoseGraph, name: str, record: Recorder) -> Floats:
        """Milliseconds (N - 1,) that each pose took to add; some stages go into the logs."""
        growing, nodes, times = backend.begin(graph.poses[0]), [0], []
        stages = set(np.linspace(1, len(graph) - 1, self.show).astype(int).tolist())
        for arrival in record.track(arrivals(graph), f"grow: {name}", len(graph) - 1, lambda _: 1):
            own = arrival.edges
            start = time.perf_counter()
            guess = moved(growing.pose(arrival.before), arrival.motion)
            said = growing.add(guess, arrival.ends, graph.motions[own], graph.information[own])
            times.append(1e3 * (time.perf_counter() - start))
            nodes.append(arrival.node)
            step = len(nodes) - 1
            for sentence in said:
                record.log("log", Text(f"{name}: {sentence}", "WARN"), Tick(step, step * STEP_NS))
            if step in stages:
                record.log(f"after/{name}", _drawn(*_so_far(graph, growing, nodes)), Tick(step, step * STEP_NS))
        steps = np.arange(1, len(graph))
        record.log(f"time/{name}", Series(np.array(times), steps, steps * STEP_NS, "ms"))
        return np.array(times)

    def _errors(self, poses: Floats, truth: Floats | None, optimum: Floats | None) -> dict[str, float]:
        """What is known of the error of poses (N, k)."""
        known = {}
        if optimum is not None:
            size = 2 if poses.shape[1] == 3 else 3
            known["rms_to_clean_m"] = rms(np.linalg.norm((poses - optimum)[:, :size], axis=1))
        if truth is not None:
            error = evaluate(matrices(poses), matrices(truth), self.alignment)
            known |= {
                "ate_m": error.ate_m,
                "rpe_metre_m": error.rpe_metre_m,
                "drift": error.drift,
                "scale": error.scale,
            }
        return known


def rivals_of(parts: Parts) -> dict[str, Backend]:
    """The run's back end, under the name of its class, and those beside it."""
    own = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", type(parts.backend).__name__).lower()
    if own in parts.backends:
        raise ConfigError(f"backends.{own} has the name of the run's backend; give it another")
    return {own: parts.backend, **parts.backends}


def _layout(names: Sequence[str], behind: str) -> ViewLayout:
    """Before, after each back end with dots `behind` it, and how it went."""
    after = [Panel("map", f"After {name}".replace("_", " "), (behind, f"after/{name}")) for name in names]
    first = (Panel("map", "Before", ("start", "truth", "before")), Panel("text", "Result", ("summary",)))
    half = 1 if len(after) < 3 else -(-len(after) // 2)
    columns = [first, tuple(after[:half]), tuple(after[half:])]
    columns[-1 if after[half:] else 1] += (Panel("log", "Log", ("log",)),)
    return ViewLayout([column for column in columns if column])


def _drawn(graph: PoseGraph, poses: Floats) -> Graph:
    return Graph(matrices(poses)[:, :3, 3], graph.edges, figures.colors(graph, poses))


def _so_far(graph: PoseGraph, growing: IncrementalGraph, nodes: list[int]) -> tuple[PoseGraph, Floats]:
    """The part of a graph among the nodes that have come, and its poses."""
    number = np.full(len(graph), -1)
    number[nodes] = np.arange(len(nodes))
    edges = number[graph.edges]
    there = (edges >= 0).all(axis=1)
    poses = growing.poses()
    part = replace(
        graph, ids=graph.ids[nodes], poses=poses, edges=edges[there],
        motions=graph.motions[there], information=graph.information[there],
    )  # fmt: skip
    return part, poses


# ---------------------------------------------------------------------------------------------------------- what it is
def _row(graph: PoseGraph, found: Optimized, wrong: Ints) -> dict[str, Any]:
    """What one back end did."""
    row: dict[str, Any] = {"chi2_before": found.chi2_before, "chi2": found.chi2}
    if len(wrong):
        out = found.weights < REJECTED
        true = np.setdiff1d(np.flatnonzero(is_loop(graph)), wrong)
        row["wrong_rejected"] = float(out[wrong].mean())
        row["true_rejected"] = float(out[true].mean()) if len(true) else float("nan")
    return {**row, "iterations": found.iterations, "problems": len(found.warnings)}


def _metrics(graph: PoseGraph, rows: Sequence[Mapping[str, Any]], wrong: Ints) -> list[Metric]:
    """Every row's numbers but the time, under the back end's name where there are several."""
    units = {"rms_to_clean_m": "m", "ate_m": "m", "rpe_metre_m": "m"}
    names = [name for name in TOLD if name in rows[0]]
    found = [
        Metric(
            f"{row['backend']}_{name}".removesuffix("_m") if len(rows) > 1 else name.removesuffix("_m"),
            float(row[name]), units.get(name, "1"),
        )
        for name in names for row in rows
    ]  # fmt: skip
    loops = int(is_loop(graph).sum()) - len(wrong)
    counts = {"poses": len(graph), "edges": len(graph.edges), "loops": loops, "wrong_loops": len(wrong)}
    return [*found, *(Metric(name, count, "1") for name, count in counts.items())]


def _columns(rows: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    return {name: [row[name] for row in rows] for name in rows[0]}


def _summary(graph: PoseGraph, rows: Sequence[Mapping[str, Any]], wrong: Ints) -> str:
    loops = int(is_loop(graph).sum())
    size = f"{len(graph)} poses, {len(graph.edges)} edges, {loops} of them loop closures, {len(wrong)} of these wrong"
    return "\n".join(["## Pose graph", "", size, "", markdown({n: c for n, c in _columns(rows).items() if n in SHOWN})])


def _edge_table(graph: PoseGraph, found: Mapping[str, Optimized], wrong: Ints) -> dict[str, Any]:
    """Every edge: which it is, and by how many standard deviations it is off."""
    ends = graph.ids[graph.edges]
    table: dict[str, Any] = {"from": ends[:, 0], "to": ends[:, 1], "loop": is_loop(graph).astype(int)}
    table["wrong"] = np.isin(np.arange(len(ends)), wrong).astype(int)
    for name, one in found.items():
        table[f"{name}_deviations"] = figures.deviations(graph, one.poses).round(6)
        table[f"{name}_weight"] = one.weights.round(6)
    return table


def _texts(graph: PoseGraph, poses: Floats) -> dict[str, str]:
    """The graph with poses (N, k) as files, by their ending."""
    stamps_ns = np.arange(len(graph), dtype=np.int64) * 10**9
    return {"g2o": g2o_text(replace(graph, poses=poses)), "tum": tum_text(matrices(poses), stamps_ns)}
