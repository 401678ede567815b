"""A pose graph as it grows: what each pose costs to add, and stages of the map for the logs."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from omnilab.api import Floats, Graph, IncrementalGraph, PoseGraph, Recorder, Series, Tick
from omnilab.posegraph.graph import matrices
from omnilab_studies.pose_graph import figures

STEP_NS = 100_000_000  # between two poses, in the logs


class Growth:
    """Watches an incremental back end (`omnilab.api.Watch`): times each pose, and logs stages of the map.

    What the logs cost is not the back end's time.
    """

    def __init__(self, name: str, graph: PoseGraph, record: Recorder, stages: int) -> None:
        count = len(graph)
        self._name, self._graph, self._record = name, graph, record
        self._stages = set(np.linspace(1, count - 1, stages).astype(int).tolist())
        self._progress = record.track(range(1, count), f"grow: {name}", count - 1, lambda _: 1)
        next(self._progress, None)
        self._nodes, self._times_ms = [0], list[float]()
        self._logging_s = 0.0
        self._start = self._since = time.perf_counter()

    def watch(self, node: int, incremental: IncrementalGraph, warnings: Sequence[str]) -> None:  # noqa: ARG002  said at the end
        """A pose was added."""
        now = time.perf_counter()
        self._times_ms.append(1e3 * (now - self._since))
        self._nodes.append(node)
        step = len(self._nodes) - 1
        if step in self._stages:
            stage = drawn(*_subgraph(self._graph, incremental.poses(), self._nodes))
            self._record.log(f"after/{self._name}", stage, Tick(step, step * STEP_NS))
        next(self._progress, None)
        self._since = time.perf_counter()
        self._logging_s += self._since - now

    def seconds(self) -> float:
        """Since the beginning, without what was spent on logs."""
        return time.perf_counter() - self._start - self._logging_s

    def log_times(self) -> Floats:
        """Milliseconds (N - 1,) that each pose took to add, which go into the logs, too."""
        steps, times_ms = np.arange(1, len(self._nodes)), np.array(self._times_ms)
        self._record.log(f"time/{self._name}", Series(times_ms, steps, steps * STEP_NS, "ms"))
        return times_ms


def drawn(graph: PoseGraph, poses: Floats) -> Graph:
    """A graph with poses (N, k), its loop closures coloured by how far they are off."""
    return Graph(matrices(poses)[:, :3, 3], graph.edges, figures.colors(graph, poses))


def _subgraph(graph: PoseGraph, poses: Floats, nodes: list[int]) -> tuple[PoseGraph, Floats]:
    """The part of a graph among the nodes that were added, and their poses (n, k)."""
    number = np.full(len(graph), -1)
    number[nodes] = np.arange(len(nodes))
    edges = number[graph.edges]
    there = (edges >= 0).all(axis=1)
    part = replace(
        graph, ids=graph.ids[nodes], poses=poses, edges=edges[there],
        motions=graph.motions[there], information=graph.information[there],
    )  # fmt: skip
    return part, poses
