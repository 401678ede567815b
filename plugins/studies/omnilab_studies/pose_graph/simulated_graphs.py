"""Simulated pose graphs: a walk on a square lattice (Manhattan world), and wrong loop closures."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from omnilab.api import Floats, Ints, PoseGraph, check_settings, setting
from omnilab.errors import ConfigError
from omnilab.posegraph.graph import between, dead_reckoning, is_loop, matrices, vectors

MIN_GAP = 10  # poses between the two of a loop closure


@dataclass
class Walk:
    """A simulated walk on a square lattice, as in Olson's Manhattan: a step ahead each time, now and then a turn at a crossing."""

    count: int = setting(500, at_least=2, at_most=1_000_000)  # poses
    side: int = setting(15, at_least=2, at_most=10_000)  # crossings along each side of the town, 1 m apart
    turn_rate: float = setting(0.3, at_least=0, at_most=1)  # of the crossings at which it turns
    loop_rate: float = setting(0.5, at_least=0, at_most=1)  # of the crossings passed before that are recognised
    sigma_m: float = setting(0.05, above=0)  # noise of each measured motion
    sigma_deg: float = setting(1.0, above=0)  # and of its rotation

    def __post_init__(self) -> None:
        check_settings(self, "study.walk.")

    def graph(self, rng: np.random.Generator) -> tuple[PoseGraph, Floats]:
        """The measured graph, its poses by odometry, and the true poses (N, 3)."""
        truth = self._path(rng)
        steps = np.column_stack([np.arange(self.count - 1), np.arange(1, self.count)])
        edges = np.concatenate([steps, _meetings(truth, self.loop_rate, rng)])
        sigma = np.array([self.sigma_m, self.sigma_m, np.radians(self.sigma_deg)])
        motions = between(truth, edges) + sigma * rng.standard_normal((len(edges), 3))
        information = np.tile(np.diag(sigma**-2), (len(edges), 1, 1))
        graph = PoseGraph(np.arange(self.count), truth, edges, motions, information)
        return replace(graph, poses=dead_reckoning(graph)), truth

    def _path(self, rng: np.random.Generator) -> Floats:
        """Poses (count, 3), from the middle of the town; never out of it."""
        at, heading, poses = np.full(2, self.side // 2), 0, []
        for _ in range(self.count):
            poses.append((*at, heading * np.pi / 2))
            turns = [-1, 1] if rng.random() < self.turn_rate else [0]
            possible = [turn for turn in turns if self._inside(_ahead(at, heading + turn))]
            possible = possible or [turn for turn in (-1, 0, 1, 2) if self._inside(_ahead(at, heading + turn))]
            heading += int(rng.choice(possible))
            at = _ahead(at, heading)
        return np.array(poses, float)

    def _inside(self, at: Ints) -> bool:
        return bool(((at >= 0) & (at < self.side)).all())


def _ahead(at: Ints, heading: int) -> Ints:
    """The next crossing (2,) in a heading, in quarter turns."""
    return np.asarray(at + [(1, 0), (0, 1), (-1, 0), (0, -1)][heading % 4])


def _meetings(truth: Floats, rate: float, rng: np.random.Generator) -> Ints:
    """Loop closures (L, 2), earlier pose first: some of those to the last time that a crossing was passed."""
    last: dict[tuple[float, ...], int] = {}
    found = []
    for i, at in enumerate(map(tuple, truth[:, :2].tolist())):
        if i - last.get(at, i) > MIN_GAP and rng.random() < rate:
            found.append((last[at], i))
        last[at] = i
    return np.array(found, int).reshape(-1, 2)


def with_wrong_loops(graph: PoseGraph, share: float, rng: np.random.Generator) -> tuple[PoseGraph, Ints]:
    """The graph with wrong loop closures at its end, a share of the number of its own; and which rows (W,) they are.

    They join random poses by motions drawn within the graph's extent, with the information of random true ones.
    """
    loops = np.flatnonzero(is_loop(graph))
    count, wrong = round(share * len(loops)), list[tuple[int, int]]()
    if count and len(graph) < 4:
        raise ConfigError(f"study.wrong_loops={share} needs a graph of 4 poses or more, this has {len(graph)}; give 0")
    while len(wrong) < count:
        i, j = rng.integers(len(graph), size=2).tolist()
        if abs(i - j) > 1:
            wrong.append((i, j))
    size = 2 if graph.planar else 3
    extent = np.ptp(graph.poses[:, :size], axis=0)
    T = np.tile(np.eye(4), (count, 1, 1))
    T[:, :size, 3] = rng.uniform(-0.5, 0.5, (count, size)) * extent
    rotation = rng.uniform(-np.pi, np.pi, count) if graph.planar else rng.standard_normal((count, 4))
    zeros = np.zeros((count, 2 if graph.planar else 3))
    T[:, :3, :3] = matrices(np.column_stack([zeros, rotation if graph.planar else _unit(rotation)]))[:, :3, :3]
    rows = rng.choice(loops, count) if count else loops[:0]
    corrupted = replace(
        graph,
        edges=np.concatenate([graph.edges, np.array(wrong, int).reshape(-1, 2)]),
        motions=np.concatenate([graph.motions, vectors(T, graph.planar)]),
        information=np.concatenate([graph.information, graph.information[rows]]),
    )
    return corrupted, np.arange(len(graph.edges), len(corrupted.edges))


def _unit(quaternion: Floats) -> Floats:
    return np.asarray(quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True))
