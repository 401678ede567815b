"""Back ends on manhattan's 3500 poses, beside GTSAM called directly; one pose at a time with `-m "slow or not slow"`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import gtsam
import numpy as np
import pytest

from omnilab.posegraph.files import read_graph
from omnilab.posegraph.graph import moved
from omnilab_slam import GtsamBatch, GtsamIsam2

FILE = Path(__file__).parents[3] / "shared/data/pose_graphs/se_sync/manhattan.g2o"
ROUNDS = {"rounds": 3, "warmup_rounds": 1}


@pytest.fixture(scope="module")
def graph():
    if not FILE.is_file():
        pytest.skip("manhattan.g2o, a published graph, is not there")
    return read_graph(FILE)


@pytest.fixture(scope="module")
def growing(graph, request):
    """All of it where it is measured, else its first poses."""
    if request.config.getoption("benchmark_enable"):
        return graph
    first = graph.edges.max(axis=1) < 500
    return replace(
        graph, ids=graph.ids[:500], poses=graph.poses[:500], edges=graph.edges[first], motions=graph.motions[first],
        information=graph.information[first],
    )  # fmt: skip


def factors_of(graph):
    factors, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for i, pose in enumerate(graph.poses):
        values.insert(i, gtsam.Pose2(*pose))
    for (i, j), motion, W in zip(graph.edges.tolist(), graph.motions, graph.information, strict=True):
        noise = gtsam.noiseModel.Gaussian.Information(W)
        factors.add(gtsam.BetweenFactorPose2(i, j, gtsam.Pose2(*motion), noise))
    factors.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(*graph.poses[0]), gtsam.noiseModel.Isotropic.Sigma(3, 1e-4)))
    return factors, values


@pytest.mark.benchmark(group="graphs: manhattan, all at once")
def test_gtsam_batch(benchmark, graph):
    found = benchmark.pedantic(GtsamBatch().optimize, (graph,), **ROUNDS)
    assert found.chi2 == pytest.approx(3549.04, rel=1e-3)


@pytest.mark.benchmark(group="graphs: manhattan, all at once")
def test_gtsam_alone(benchmark, graph):
    def solve():
        factors, values = factors_of(graph)
        return gtsam.utilities.extractPose2(gtsam.LevenbergMarquardtOptimizer(factors, values).optimize())

    assert benchmark.pedantic(solve, **ROUNDS).shape == (3500, 3)


@pytest.mark.slow
@pytest.mark.benchmark(group="graphs: manhattan, one pose at a time")
def test_gtsam_isam2(benchmark, growing):
    benchmark.pedantic(GtsamIsam2(settle=0).optimize, (growing,), rounds=1)


@pytest.mark.slow
@pytest.mark.benchmark(group="graphs: manhattan, one pose at a time")
def test_gtsam_isam2_in_a_bare_loop(benchmark, growing):
    graph = growing

    def solve():
        parameters = gtsam.ISAM2Params()
        parameters.setFactorization("QR")
        parameters.setRelinearizeThreshold(0.1)
        parameters.relinearizeSkip = 10
        tree = gtsam.ISAM2(parameters)
        by_newest = [[] for _ in range(len(graph))]
        for e, newest in enumerate(graph.edges.max(axis=1)):
            by_newest[newest].append(e)
        for i in range(len(graph)):
            factors, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
            for e in by_newest[i]:
                noise = gtsam.noiseModel.Gaussian.Information(graph.information[e])
                factors.add(gtsam.BetweenFactorPose2(*graph.edges[e].tolist(), gtsam.Pose2(*graph.motions[e]), noise))
            if i == 0:
                anchor = gtsam.noiseModel.Isotropic.Sigma(3, 1e-4)
                factors.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(), anchor))
                values.insert(0, gtsam.Pose2())
            else:
                step = next(e for e in by_newest[i] if graph.edges[e].tolist() == [i - 1, i])
                values.insert(i, tree.calculateEstimatePose2(i - 1).compose(gtsam.Pose2(*graph.motions[step])))
            tree.update(factors, values)
        return gtsam.utilities.extractPose2(tree.calculateEstimate())

    bare = benchmark.pedantic(solve, rounds=1)
    assert np.allclose(bare, GtsamIsam2(settle=0).optimize(graph).poses, atol=1e-6)


@pytest.mark.benchmark(group="graphs: files")
def test_reading_manhattan(benchmark, graph):
    assert len(benchmark.pedantic(read_graph, (FILE,), **ROUNDS)) == len(graph)


@pytest.mark.benchmark(group="graphs: files")
def test_composing_a_pose(benchmark, graph):
    benchmark(moved, graph.poses[0], graph.motions[0])
