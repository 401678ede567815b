"""Incremental smoothing and mapping (iSAM2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from omnilab.api import Bools, Floats, Ints, Optimized, PoseGraph, Watch, check_settings, setting
from omnilab.posegraph.graph import arrivals, check_graph, chi2, edge_chi2, inverse, is_loop, matrices, moved, vectors
from omnilab_slam.factors import (
    anchor,
    factor_of,
    factors_of,
    noise_of,
    pose_of,
    poses_of,
    robust,
    vector_of,
)
from omnilab_slam.kernels import Kernel, weights, why
from omnilab_slam.solvers import (
    FAILURES,
    brief,
    check_start,
    empty_tree,
    is_singular,
    with_covariances,
    with_trust,
)
from omnilab_slam.starts import beside_chordal

LOOSE_SIGMA = 1.0  # m and rad: the tie of a pose whose update failed


@dataclass
class GtsamIsam2:
    """iSAM2 (Kaess et al., 2012): each pose is added to a Bayes tree of which only what it touches is solved again.

    It solves by Cholesky. Where that fails (GTSAM takes variables for undetermined of which one is known 4096 times as well as
    the next), the tree is built anew from the same factors and linearisation points by QR, which stands more and takes longer,
    and goes on so; that is said. `optimize` adds a graph's poses one by one, guessed from the poses there are, whatever the
    graph's own say. Robust kernels are for loop closures; redescending ones would keep wrong ones out
    from the start and right ones after a drift.
    """

    relinearize_threshold: float = setting(
        0.1, at_least=0
    )  # m and rad that a pose may move before its edges are linearised anew
    relinearize_every: int = setting(10, at_least=1)  # updates
    settle: int = setting(5, at_least=0, at_most=10_000)  # updates without new poses at the end
    kernel: Kernel = Kernel.none  # none, huber, cauchy, geman_mcclure, welsch, tukey or dcs
    kernel_width: float | None = setting(None, above=0)  # in standard deviations; null: the kernel's usual one

    def __post_init__(self) -> None:
        check_settings(self, "backend.")

    def begin(self, first_pose: Floats) -> Isam2Graph:
        """An incremental graph of one pose (k,), which stays."""
        return Isam2Graph(self, first_pose)

    def optimize(self, graph: PoseGraph, covariances: bool = False, watch: Watch | None = None) -> Optimized:
        """Add every pose with its edges to those before it, then update without new poses."""
        check_graph(graph)
        check_start(graph, graph.poses)
        incremental, order, warnings = self.begin(graph.poses[0]), [0], list[str]()
        loops = is_loop(graph)
        for arrival in arrivals(graph):
            guess = moved(incremental.pose(arrival.before), arrival.motion)
            e = arrival.edges
            failures = incremental.add(guess, arrival.ends, graph.motions[e], graph.information[e], loops[e])
            warnings += failures
            order.append(arrival.node)
            if watch is not None:
                watch(arrival.node, incremental, failures)
        warnings += incremental.settle(self.settle)
        poses = np.empty_like(graph.poses)
        poses[order] = incremental.poses()
        edge_errors = edge_chi2(graph, poses)
        weight = weights(self.kernel, self.kernel_width, loops, edge_errors)
        found = Optimized(
            poses, chi2(graph), float(edge_errors.sum()), len(graph) - 1 + self.settle, weight, warnings=warnings,
            notes=incremental.notes,
        )  # fmt: skip
        found = with_trust(found, loops, why(self.kernel))
        if self.kernel is Kernel.none:
            found = beside_chordal(graph, found)
        return (
            with_covariances(found, factors_of(graph, self.noises(graph.information, loops))) if covariances else found
        )

    def noises(self, information: Floats, loops: Any) -> list[Any]:
        """Noise models of edges, from information (e, d, d) and which of them are loop closures (e,)."""
        return robust([noise_of(W) for W in information], loops, self.kernel, self.kernel_width)


class Isam2Graph:
    """Incremental pose graph in a Bayes tree, with its factors, from which the tree is rebuilt should an update fail."""

    def __init__(self, settings: GtsamIsam2, first_pose: Floats) -> None:
        import gtsam

        self._settings, self._planar = settings, len(first_pose) == 3
        self._factors = gtsam.NonlinearFactorGraph()
        self._factorization = "CHOLESKY"
        self.notes: list[str] = []  # what happened, in sentences, where nothing went wrong
        self._tree = self._empty_tree()
        self._count = 0
        self._update([anchor(first_pose)], first_pose)

    def add(
        self, pose: Floats, edges: Ints, motions: Floats, information: Floats, loops: Bools | None = None
    ) -> list[str]:
        """See `omnilab.api.IncrementalGraph`. `loops` (e,): which edges are not of odometry; None: not to the next number."""
        loops = np.abs(edges[:, 1] - edges[:, 0]) != 1 if loops is None else loops
        noises = self._settings.noises(information, loops)
        measured = zip(edges.tolist(), motions, noises, strict=True)
        try:
            self._update([factor_of(i, j, motion, noise) for (i, j), motion, noise in measured], pose)
        except FAILURES as error:
            self._recover(pose)
            return [f"pose {self._count - 1} could not be added ({brief(error)}); it stays where it was guessed"]
        return []

    def pose(self, number: int) -> Floats:
        """See `omnilab.api.IncrementalGraph`."""
        tree = self._tree
        return vector_of((tree.calculateEstimatePose2 if self._planar else tree.calculateEstimatePose3)(number))

    def poses(self) -> Floats:
        """See `omnilab.api.IncrementalGraph`."""
        return poses_of(self._tree.calculateEstimate(), self._planar)

    def settle(self, updates: int) -> list[str]:
        """Update without new poses, linearising anew what has moved."""
        import gtsam

        force = gtsam.ISAM2UpdateParams()
        force.force_relinearize = True
        for _ in range(updates):
            try:
                self._advance(gtsam.NonlinearFactorGraph(), gtsam.Values(), force)
            except FAILURES as error:
                self._rebuild()
                return [f"the map could not settle ({brief(error)}); it stays as it was"]
        return []

    def _empty_tree(self) -> Any:
        """A Bayes tree without poses."""
        settings = self._settings
        return empty_tree(settings.relinearize_threshold, settings.relinearize_every, self._factorization)

    def _advance(self, factors: Any, values: Any, *settings: Any) -> None:
        """An update of the tree; should Cholesky fail, the tree is built again by QR, and stays so."""
        try:
            self._tree.update(factors, values, *settings)
        except FAILURES as error:
            if self._factorization == "QR" or not is_singular(error):
                raise
            self._factorization = "QR"
            self.notes.append(
                f"Cholesky fails at pose {self._count}: from there on iSAM2 solves by QR, which takes longer"
            )
            self._rebuild()
            self._tree.update(factors, values, *settings)

    def _update(self, factors: list[Any], pose: Floats) -> None:
        """Add one more pose (k,) with its factors."""
        import gtsam

        new, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        for factor in factors:
            new.push_back(factor)
        values.insert(self._count, pose_of(pose))
        self._advance(new, values)
        self._factors.push_back(new)
        self._count += 1

    def _recover(self, pose: Floats) -> None:
        """Rebuild the tree as it was before an update failed, the new pose (k,) tied loosely to the one before it."""
        import gtsam

        self._rebuild()
        last = self.pose(self._count - 1)
        motion = vectors(inverse(matrices(last[None])) @ matrices(pose[None]), self._planar)[0]
        noise = gtsam.noiseModel.Isotropic.Sigma(3 if self._planar else 6, LOOSE_SIGMA)
        self._update([factor_of(self._count - 1, self._count, motion, noise)], pose)

    def _rebuild(self) -> None:
        """A new tree of what the old one held: a failed update breaks GTSAM's for good."""
        values = self._tree.getLinearizationPoint()
        if values.exists(self._count):
            values.erase(self._count)
        self._tree = self._empty_tree()
        self._tree.update(self._factors, values)
