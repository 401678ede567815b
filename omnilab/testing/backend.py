"""The conformance check of back ends."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from omnilab import api
from omnilab.api import Floats
from omnilab.errors import DataError
from omnilab.geometry import planar_poses
from omnilab.posegraph.graph import arrivals, between, matrices, moved, vectors
from omnilab.testing.common import expect
from omnilab.testing.rules import CannotCheckError, Trial, Work, conform, rule


def check_backend(backend: Any) -> None:
    """Perfect motions are met exactly from bad guesses, planar and spatial; the first pose stays; deterministic; pickles.

    Covariances are symmetric and positive; the graph that was given is left alone; one in two parts is refused. One that
    takes poses as they come ends where the others do.
    """
    conform(BackendTrial(backend))


class BackendTrial(Trial):
    """A back end, and rings of twelve poses in the plane and in space whose motions are perfect."""

    kind = "backend"

    @cached_property
    def rings(self) -> list[tuple[api.PoseGraph, Floats]]:
        return [_ring(planar=True), _ring(planar=False)]

    @cached_property
    def optimized(self) -> list[api.Optimized]:
        return [self.component.optimize(graph, covariances=True) for graph, _ in self.rings]

    def work(self) -> Work:
        graph, _ = self.rings[0]
        return Work(lambda: self.given.optimize(graph), 1, "graph")

    @rule("meets perfect motions from bad guesses, planar and spatial, and leaves the graph as it is")
    def meets(self) -> None:
        guessed = [graph.poses.copy() for graph, _ in self.rings]
        for (graph, truth), before, found in zip(self.rings, guessed, self.optimized, strict=True):
            expect(np.array_equal(graph.poses, before), "the poses that were given are changed")
            met = bool(np.allclose(matrices(found.poses), matrices(truth), atol=1e-4))
            expect(met, "perfect motions are not met; iterate until the poses no longer move")
            expect(found.chi2 < 1e-6 < found.chi2_before, f"chi2 goes from {found.chi2_before} to {found.chi2}")

    @rule("trusts edges that fit")
    def trusts(self) -> None:
        for (graph, _), found in zip(self.rings, self.optimized, strict=True):
            expect(found.weights.shape == (len(graph.edges),), "weights are not one for each edge")
            expect(bool(((found.weights > 0.5) & (found.weights <= 1)).all()), "edges that fit are not trusted")
            trusted = found.trusted
            expect(trusted is None or trusted.shape == (len(graph.edges),), "what was trusted is not one for each edge")

    @rule("gives positive covariances where they are asked for")
    def covariances(self) -> None:
        for (graph, _), found in zip(self.rings, self.optimized, strict=True):
            d = 3 if graph.planar else 6
            assert found.covariances is not None
            expect(np.shape(found.covariances) == (len(graph), d, d), f"covariances are {np.shape(found.covariances)}")
            positive = bool((np.linalg.eigvalsh(found.covariances) > 0).all())
            expect(positive, "covariances are not positive definite")

    @rule("gives the same poses each time")
    def deterministic(self) -> None:
        for (graph, _), found in zip(self.rings, self.optimized, strict=True):
            again = self.component.optimize(graph)
            expect(np.array_equal(again.poses, found.poses), "the same graph gives other poses the second time")

    @rule("refuses a graph in two parts with a DataError")
    def parts(self) -> None:
        graph, _ = self.rings[0]
        apart = replace(graph, edges=graph.edges[2:], motions=graph.motions[2:], information=graph.information[2:])
        apart = replace(apart, edges=np.where(apart.edges == 1, 2, apart.edges))
        try:
            self.component.optimize(apart)
        except DataError:
            return
        raise AssertionError(
            "a graph in two parts is optimised without a word; call omnilab.posegraph.graph.check_graph first"
        )

    @rule("takes poses as they come, and ends where it does otherwise")
    def incremental(self) -> None:
        if not isinstance(self.given, api.IncrementalBackend):
            raise CannotCheckError("it takes whole graphs alone")
        for (graph, truth), found in zip(self.rings, self.optimized, strict=True):
            _check_watch(self.component, graph, found.poses)
            _check_incremental(self.component.begin(graph.poses[0]), graph, truth)


def _check_watch(backend: Any, graph: api.PoseGraph, poses: Floats) -> None:
    """Whoever watches is called after each pose, with the map so far, and changes nothing."""
    seen: list[tuple[int, int]] = []
    watched = backend.optimize(graph, watch=lambda node, so_far, _: seen.append((node, len(so_far.poses()))))
    expect(seen == [(i, i + 1) for i in range(1, len(graph))], f"who watches sees (row, poses) {seen}")
    expect(np.array_equal(watched.poses, poses), "the same graph gives other poses when it is watched")


def _check_incremental(incremental: Any, graph: api.PoseGraph, truth: Floats) -> None:
    """Poses come one by one; each is there at once, and all are right at the end."""
    for arrival in arrivals(graph):
        own, guess = arrival.edges, moved(incremental.pose(arrival.before), arrival.motion)
        warnings = incremental.add(guess, arrival.ends, graph.motions[own], graph.information[own])
        expect(not warnings, f"adding a pose goes wrong: {warnings}")
        expect(len(incremental.poses()) == arrival.node + 1, "there are not as many poses as were added")
    expect(bool(np.allclose(matrices(incremental.poses()), matrices(truth), atol=1e-4)), "perfect motions are not met")
    number, nowhere = len(graph), np.array([[0, len(graph) + 5]])
    warnings = incremental.add(truth[0], nowhere, graph.motions[:1], graph.information[:1])
    expect(len(warnings) > 0, "an edge to a pose that is not there is taken without a word")
    expect(len(incremental.poses()) == number + 1, "an update that failed loses its pose")
    expect(
        bool(np.allclose(matrices(incremental.poses()[:-1]), matrices(truth), atol=1e-3)),
        "a failed update costs the map",
    )


def _ring(planar: bool) -> tuple[api.PoseGraph, Floats]:
    """Twelve poses on a circle with perfect motions to the next and some across, guessed badly; and the true poses."""
    rng = np.random.default_rng(2)
    angle = np.arange(12) * np.pi / 6
    T = planar_poses(np.column_stack([np.cos(angle), np.sin(angle), 0 * angle if planar else angle / 3]), angle + 1.5)
    pairs = [(i, (i + 1) % 12) for i in range(12)] + [(0, 5), (3, 9), (7, 2)]
    edges = np.array(pairs)
    truth = vectors(T, planar)
    spread = rng.standard_normal((len(edges), truth.shape[1] if planar else 6, truth.shape[1] if planar else 6))
    information = spread @ spread.transpose(0, 2, 1) + 50 * np.eye(spread.shape[1])
    guess = vectors(T @ planar_poses(rng.normal(0, 0.1, (12, 3)) * [1, 1, not planar], rng.normal(0, 0.1, 12)), planar)
    guess[0] = truth[0]
    return api.PoseGraph(np.arange(12), guess, edges, between(truth, edges), information), truth
