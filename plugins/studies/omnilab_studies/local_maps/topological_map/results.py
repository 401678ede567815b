"""Results of topological maps: residuals of maps of whole grids, fitted to the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Embedding, Floats, Ints, Metric
from omnilab.geometry import Similarity, procrustes
from omnilab_studies.common.tables import markdown
from omnilab_studies.local_maps.topological_map.lengths import Lengths

Table = Mapping[str, Sequence[Any]]
ON_NODE = 0.1  # steps that a neighbour may be off its node
NEIGHBOURS = 4  # of a node of a grid
COMBINED = "combined"  # the method of maps from several methods' distances


class TopologicalMapCase(NamedTuple):
    """Grid, method, lengths and localizer of a topological map."""

    step_m: float
    method: str
    lengths: Lengths
    localizer: str
    room: str = ""  # where the study has several


@dataclass(frozen=True)
class TopologicalMapResult:
    """An embedding of n images, fitted to their true positions."""

    case: TopologicalMapCase
    position_m: Floats  # (n, 3) the truth
    length: Floats  # (n, n) the distances that were embedded
    embedding: Embedding
    embed_s: float  # wall time of the embedding

    @cached_property
    def fit(self) -> Similarity:
        """The similarity that takes the embedding to the world."""
        return procrustes(self.embedding.position[0], self.position_m[:, :2])

    @cached_property
    def estimate_m(self) -> Floats:
        """Positions (n, 2) of the images in the fitted map."""
        return self.fit.apply(self.embedding.position[0])

    @property
    def rms_m(self) -> float:
        """Root mean square of the residuals."""
        return float(np.sqrt(np.mean(np.sum((self.estimate_m - self.position_m[:, :2]) ** 2, axis=1))))

    @property
    def rms_steps(self) -> float:
        """The same, in steps of the grid."""
        return self.rms_m / self.case.step_m

    @cached_property
    def neighbours_kept(self) -> float:
        """Share of the true grid neighbours that are among the four nearest in the map."""
        apart = np.linalg.norm(self.estimate_m[:, None] - self.estimate_m, axis=-1)
        np.fill_diagonal(apart, np.inf)
        nearest = np.argsort(apart, axis=1, kind="stable")[:, :NEIGHBOURS]
        ends = grid_edges(self.position_m, self.case.step_m)
        both = np.concatenate([ends, ends[:, ::-1]])
        return float((nearest[both[:, 0]] == both[:, 1:]).any(axis=1).mean()) if len(both) else float("nan")

    @property
    def embedding_title(self) -> str:
        """Localizer and lengths."""
        return f"{self.case.localizer}, {self.case.lengths.title}"

    @property
    def title(self) -> str:
        """Case and residual, for the logs."""
        return (
            f"{self.case.method}, {self.embedding_title}, step {self.case.step_m:g} m{_room(self.case)}:"
            f" RMS {self.rms_steps:.2f} steps"
        )


def grid_edges(position_m: Floats, step_m: float) -> Ints:
    """The pairs (E, 2) of positions (n, 3) that are one step apart."""
    apart = np.linalg.norm(position_m[:, None] - position_m, axis=-1)
    return np.argwhere(np.triu(np.abs(apart - step_m) < ON_NODE * step_m, 1))


def best_of_each(maps: Sequence[TopologicalMapResult]) -> list[TopologicalMapResult]:
    """The map with the least residual of every step and method."""
    groups = dict.fromkeys(one.case[:2] for one in maps)
    return [min((one for one in maps if one.case[:2] == group), key=lambda one: one.rms_m) for group in groups]


def result_table(maps: Sequence[TopologicalMapResult]) -> Table:
    """The table `topological_maps`: one row a map."""
    return {
        **_cases(maps),
        "nodes": [len(one.position_m) for one in maps],
        "rms_m": [one.rms_m for one in maps],
        "rms_steps": [one.rms_steps for one in maps],
        "neighbours_kept": [one.neighbours_kept for one in maps],
        "stress": [float(one.embedding.stress[0]) for one in maps],
        "iterations": [int(one.embedding.iterations[0]) for one in maps],
    }


def time_table(maps: Sequence[TopologicalMapResult]) -> Table:
    """The table `times`: wall time of each embedding, including that of keeping its intermediate states."""
    return {**_cases(maps), "nodes": [len(one.position_m) for one in maps], "embed_s": [one.embed_s for one in maps]}


def _cases(maps: Sequence[TopologicalMapResult]) -> dict[str, list[Any]]:
    cases = [one.case for one in maps]
    rooms = {"room": [case.room for case in cases]} if any(case.room for case in cases) else {}
    return {
        **rooms,
        "step_m": [case.step_m for case in cases],
        "method": [case.method for case in cases],
        "links": [case.lengths.links for case in cases],
        "lengths": [case.lengths.name for case in cases],
        "localizer": [case.localizer for case in cases],
    }


def metrics_of(maps: Sequence[TopologicalMapResult], left_out: int) -> list[Metric]:
    """The best map of the first step, the best of each step (by each kind of lengths, too), and every map of the first step."""
    first = [one for one in maps if one.case.step_m == maps[0].case.step_m]
    best = min(first, key=lambda one: one.rms_m)
    steps = dict.fromkeys(one.case.step_m for one in maps)
    return [
        Metric("best_rms_steps", best.rms_steps, "1"),
        Metric("best_rms", best.rms_m, "m"),
        Metric("best_neighbours_kept", best.neighbours_kept, "1", note="no two nodes are neighbours on the grid"),
        *(
            Metric(f"best_rms_steps_at_{s:g}_m", min(one.rms_steps for one in maps if one.case.step_m == s), "1")
            for s in steps
        ),
        *_best_by_lengths(maps),
        *(
            Metric(f"rms_steps_{_key(one.case)}", one.rms_steps, "1")
            for one in sorted(first, key=lambda one: one.rms_m)
        ),
        *(
            Metric(f"rms_steps_{_key(one.case)}_at_{one.case.step_m:g}_m", one.rms_steps, "1")
            for one in maps
            if one.case.method == COMBINED
        ),
        Metric("nodes", len(best.position_m), "1"),
        Metric("maps", len(maps), "1"),
        Metric("left_out", left_out, "1"),
    ]


def _best_by_lengths(maps: Sequence[TopologicalMapResult]) -> list[Metric]:
    """The least residual of every kind of lengths at every step."""
    least: dict[tuple[float, str], float] = {}
    for one in maps:
        group = (one.case.step_m, one.case.lengths.name)
        least[group] = min(one.rms_steps, least.get(group, np.inf))
    return [Metric(f"best_rms_steps_{name}_at_{step_m:g}_m", rms, "1") for (step_m, name), rms in least.items()]


def _key(case: TopologicalMapCase) -> str:
    return f"{case.method.replace(' + ', '_')}_{case.lengths.name}_{case.localizer}"


def summary_of(maps: Sequence[TopologicalMapResult]) -> str:
    """All maps as Markdown, the best of each step first."""
    shown = ("method", "lengths", "localizer", "rms_steps", "rms_m", "neighbours_kept", "stress", "iterations")
    parts = ["## Topological maps"]
    for step_m in dict.fromkeys(one.case.step_m for one in maps):
        ranking = sorted((one for one in maps if one.case.step_m == step_m), key=lambda one: one.rms_m)
        table = result_table(ranking)
        parts += [
            f"### {step_m:g} m, {len(ranking[0].position_m)} images{_room(ranking[0].case)}",
            markdown({name: table[name] for name in shown}),
        ]
    return "\n\n".join(parts)


def _room(case: TopologicalMapCase) -> str:
    return f", {case.room}" if case.room else ""
