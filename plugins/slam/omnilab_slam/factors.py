"""Pose graphs as GTSAM's factor graphs.

GTSAM orders rotation before translation in space, the contract after it.

GTSAM's error of an edge is the logarithm in full. Its translation differs from that of `omnilab.posegraph.graph.residuals` as the
chord of an arc does from the arc: where all edges fit to a few degrees, the optima agree to five digits.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from omnilab.api import Floats, PoseGraph
from omnilab.posegraph.graph import matrices, vectors
from omnilab_slam.kernels import Kernel, estimator

ANCHOR_SIGMA = 1e-4  # m and rad, of the first pose: it costs nothing at the optimum
ROTATION_FIRST = [3, 4, 5, 0, 1, 2]
Noise = Any  # gtsam.noiseModel.Base


def pose_of(vector: Floats) -> Any:
    """A pose or motion (k,) as GTSAM's Pose2 or Pose3."""
    import gtsam

    if len(vector) == 3:
        return gtsam.Pose2(*vector.tolist())
    return gtsam.Pose3(matrices(vector[None])[0])


def poses_as_gtsam(poses: Floats) -> list[Any]:
    """Poses or motions (N, k) as GTSAM's, all at once."""
    import gtsam

    if poses.shape[1] == 3:
        return [gtsam.Pose2(*pose) for pose in poses.tolist()]
    return [gtsam.Pose3(T) for T in matrices(poses)]


def vector_of(pose: Any) -> Floats:
    """A pose of GTSAM as (k,)."""
    import gtsam

    if isinstance(pose, gtsam.Pose2):
        return np.array([pose.x(), pose.y(), pose.theta()])
    return np.asarray(vectors(pose.matrix()[None], planar=False)[0])


def noise_of(information: Floats) -> Noise:
    """Gaussian noise model of an edge's information matrix (d, d)."""
    import gtsam

    if len(information) == 6:
        information = information[ROTATION_FIRST][:, ROTATION_FIRST]
    return gtsam.noiseModel.Gaussian.Information(information)


def noises_of(information: Floats) -> list[Noise]:
    """Noise models of information matrices (E, d, d), one for all that are the same."""
    keys = [W.tobytes() for W in information]
    models = {key: noise_of(W) for key, W in dict(zip(keys, information, strict=True)).items()}
    return [models[key] for key in keys]


def factor_of(i: int, j: int, motion: Floats, noise: Noise) -> Any:
    """Between factor: the measured motion (k,) from pose i to pose j."""
    import gtsam

    kind = gtsam.BetweenFactorPose2 if len(motion) == 3 else gtsam.BetweenFactorPose3
    return kind(i, j, pose_of(motion), noise)


def anchor(pose: Floats) -> Any:
    """Prior factor that keeps pose 0 at (k,)."""
    import gtsam

    noise = gtsam.noiseModel.Isotropic.Sigma(3 if len(pose) == 3 else 6, ANCHOR_SIGMA)
    kind = gtsam.PriorFactorPose2 if len(pose) == 3 else gtsam.PriorFactorPose3
    return kind(0, pose_of(pose), noise)


def values_of(poses: Floats) -> Any:
    """Poses (N, k) as GTSAM's values, by row."""
    import gtsam

    values = gtsam.Values()
    for i, pose in enumerate(poses_as_gtsam(poses)):
        values.insert(i, pose)
    return values


def poses_of(values: Any, planar: bool) -> Floats:
    """Poses (N, k) of GTSAM's values."""
    import gtsam

    if planar:
        return np.asarray(gtsam.utilities.extractPose2(values))
    rows = np.asarray(gtsam.utilities.extractPose3(values))  # R row by row, t
    T = np.tile(np.eye(4), (len(rows), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = rows[:, :9].reshape(-1, 3, 3), rows[:, 9:]
    return vectors(T, planar=False)


def factors_of(graph: PoseGraph, noises: Iterable[Noise]) -> Any:
    """Factor graph: the graph's edges with these noise models, in their order, and the anchor at the end."""
    import gtsam

    factors = gtsam.NonlinearFactorGraph()
    kind: Any = gtsam.BetweenFactorPose2 if graph.planar else gtsam.BetweenFactorPose3
    for (i, j), motion, noise in zip(graph.edges.tolist(), poses_as_gtsam(graph.motions), noises, strict=True):
        factors.add(kind(i, j, motion, noise))
    factors.add(anchor(graph.poses[0]))
    return factors


def robust(noises: list[Noise], loops: Any, kernel: Kernel, width: float | None) -> list[Noise]:
    """The same noise models, those of loop closures (E,) with a robust kernel."""
    import gtsam

    if kernel is Kernel.none:
        return noises
    within, form = gtsam.noiseModel.Robust.Create, estimator(kernel, width)
    return [within(form, noise) if loop else noise for noise, loop in zip(noises, loops, strict=True)]


def marginals(factors: Any, values: Any, planar: bool) -> Floats:
    """Marginal covariances (N, d, d) of all poses, each in its own frame."""
    import gtsam

    joint = gtsam.Marginals(factors, values)
    covariances = np.array([joint.marginalCovariance(i) for i in range(values.size())])
    return covariances if planar else covariances[:, ROTATION_FIRST][:, :, ROTATION_FIRST]
