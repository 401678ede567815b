"""Planar relative pose of 300 matches, 40 % of them wrong, beside OpenCV's five points.

pytest tests/benchmarks/test_bench_planar.py --benchmark-enable -n 0

`extra_info` of each holds how often it succeeded (both angles within 5 degrees) and the median errors in degrees. The
five-point model knows no bearings beyond a picture plane: all lie within a cone of 90 degrees there.
"""

import itertools

import numpy as np
import pytest

from omnilab.geometry import wrap_angle
from omnilab_appearance.common.relative_pose import Solver, pose_of

COUNT, WRONG, NOISE_RAD, PAIRS = 300, 120, 1e-3, 200


def bearings(rng, cone):
    if not cone:
        d = rng.standard_normal((COUNT, 3))
        return d / np.linalg.norm(d, axis=1, keepdims=True)
    cosine = rng.uniform(np.cos(np.deg2rad(45)), 1, COUNT)
    around = rng.uniform(0, 2 * np.pi, COUNT)
    sine = np.sqrt(1 - cosine**2)
    return np.column_stack([cosine, sine * np.cos(around), sine * np.sin(around)])


def noisy(points, rng):
    d = points / np.linalg.norm(points, axis=1, keepdims=True) + NOISE_RAD * rng.standard_normal(points.shape)
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def problems(cone):
    """PAIRS times p, q, phi and beta; a step of 0.3 among points 1 to 4 away, turns of up to 17 degrees."""
    rng = np.random.default_rng(0)
    made = []
    for _ in range(PAIRS):
        phi, beta = rng.uniform(-0.3, 0.3), rng.uniform(-np.pi, np.pi)
        points = bearings(rng, cone) * rng.uniform(1, 4, (COUNT, 1))
        c, s = np.cos(phi), np.sin(phi)
        moved = points - 0.3 * np.array([np.cos(beta), np.sin(beta), 0])
        seen = moved @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        seen[:WRONG] = bearings(rng, cone)[:WRONG]
        made.append((noisy(points, rng), noisy(seen, rng), phi, beta))
    return made


def planar(solver):
    return lambda p, q: pose_of(p, q, np.random.default_rng(0), solver)[:2]


def five_points(p, q):
    """OpenCV looks along +z: x right is the camera's -y, y down its -z, z ahead its +x."""
    import cv2

    axes = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0.0]])
    first, second = ((d @ axes.T)[:, :2] / (d @ axes.T)[:, 2:] for d in (p, q))
    E, _ = cv2.findEssentialMat(first, second, np.eye(3), cv2.USAC_DEFAULT, 0.999, np.deg2rad(0.2))
    if E is None or E.shape != (3, 3):
        return np.nan, np.nan
    return E, first, second


def angles(told):
    """phi and beta of what five_points tells; not timed."""
    import cv2

    if len(told) == 2:
        return told
    axes = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0.0]])
    _, R, t, _ = cv2.recoverPose(*told)
    turn = axes.T @ R.T @ axes
    way = axes.T @ -R.T @ t[:, 0]
    return np.arctan2(turn[1, 0], turn[0, 0]), np.arctan2(way[1], way[0])


@pytest.mark.parametrize(
    ("solve", "cone"),
    [
        pytest.param(planar(Solver.two_point), True, id="two_point, cone"),
        pytest.param(planar(Solver.linear), True, id="linear, cone"),
        pytest.param(five_points, True, id="OpenCV's five points, cone"),
        pytest.param(planar(Solver.two_point), False, id="two_point, all around"),
        pytest.param(planar(Solver.linear), False, id="linear, all around"),
    ],
)
def test_relative_pose(benchmark, solve, cone, request):
    benchmark.group = f"relative pose of 300 matches, {'within a cone' if cone else 'all around'}"
    benchmark.extra_info.update(what=request.node.callspec.id.partition(",")[0], peer=solve is five_points)
    benchmark.extra_info["no_peer"] = "OpenCV's five points know no bearings beyond a picture plane"
    pairs = problems(cone)
    told = np.array([angles(solve(p, q)) for p, q, _, _ in pairs])
    error = np.rad2deg(np.abs(wrap_angle(told - [pair[2:] for pair in pairs])))
    good = (error < 5).all(axis=1)
    benchmark.extra_info["success"] = round(float(good.mean()), 3)
    benchmark.extra_info["median error, phi and beta, deg"] = np.nanmedian(error, axis=0).round(4).tolist()
    turns = itertools.cycle(pairs)
    benchmark.pedantic(lambda pair: solve(*pair[:2]), setup=lambda: ((next(turns),), {}), rounds=PAIRS)
