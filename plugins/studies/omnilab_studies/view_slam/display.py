"""View-based SLAM in the logs: trajectory, views with their ellipses, bearings, errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from omnilab.api import (
    Bools,
    Floats,
    Graph,
    Ints,
    PlaceMap,
    PointCloud,
    Pose,
    Recorder,
    Series,
    Tick,
    ViewFilter,
    ViewMap,
)
from omnilab.posegraph.graph import matrices
from omnilab_studies.view_slam.consistency import ellipses, errors
from omnilab_studies.view_slam.drives import Drive
from omnilab_studies.view_slam.filter_runs import FilterEstimate, run_filter
from omnilab_studies.view_slam.scenarios import Scenario

STEP_NS = 500_000_000
DOTS = 5  # a step of a trajectory
RAISED_M = 0.05  # carpets would hide what lies on the floor
TRUTH, ODOMETRY, ESTIMATE, WALL = (150, 160, 175), (233, 163, 32), (47, 109, 179), (90, 96, 110)
BELIEVED, GATED = (42, 157, 92), (214, 69, 65)
AXES = ("x_m", "y_m", "heading_deg")


def show_drive(
    record: Recorder, view_filter: ViewFilter, drive: Drive, ground: Scenario, range_m: float
) -> FilterEstimate:
    """Run a filter on a drive, step by step in the logs; then its errors with bands of two standard deviations."""
    record.log("taken", PlaceMap(_at(drive.truth[drive.view_steps])))
    if len(ground.walls_m):
        record.log("walls", segments(ground.walls_m, [WALL] * len(ground.walls_m)))
    record.log("truth", line(drive.truth, TRUTH))
    record.log("odometry", line(drive.odometry, ODOMETRY))
    trajectory: list[Floats] = [drive.truth[0]]
    last: list[tuple[Floats, Floats]] = []

    def watch(step: int, view_map: ViewMap, observed: Ints, believed: Bools) -> None:
        trajectory.append(view_map.pose()[0])
        last[:] = [(view_map.views(), view_map.view_covariances())]
        bearings = Bearings(observed, drive.angles_rad[step, observed, 0], believed)
        show_step(record, Tick(step, step * STEP_NS), np.array(trajectory), last[0], observed, bearings)

    trace = run_filter(view_filter, drive, range_m, watch)
    show_errors(record, trace.poses, trace.covariances, drive.truth)
    return FilterEstimate(trace.poses, trace.covariances, *last[0])


class Bearings(NamedTuple):
    """Observations of K views."""

    views: Ints  # (K,)
    bearings_rad: Floats  # (K,)
    believed: Bools  # (K,)


def show_step(
    record: Recorder, tick: Tick, trajectory: Floats, views: tuple[Floats, Floats], candidates: Ints, observed: Bearings
) -> None:
    """The trajectory so far (T, 3), views (N, 3) with covariances (N, 3, 3), candidates (C,) and observed bearings."""
    poses, covariances = views
    record.log("robot", Pose(matrices(trajectory[-1:])[0]), tick)
    record.log("trajectory", line(trajectory, ESTIMATE), tick)
    record.log("views", outlines(poses, covariances), tick)
    robot = trajectory[-1, :2]
    record.log("candidates", rays(robot, poses[candidates, :2], [TRUTH] * len(candidates)), tick)
    distance_m = np.linalg.norm(poses[observed.views, :2] - robot, axis=1)
    angle = trajectory[-1, 2] + observed.bearings_rad
    ends = robot + distance_m[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    record.log("bearings", rays(robot, ends, [BELIEVED if each else GATED for each in observed.believed]), tick)


def show_errors(record: Recorder, poses: Floats, covariances: Floats, truth: Floats) -> None:
    """Errors of poses (T, 3) in x, y and heading, and twice their standard deviations, as curves."""
    steps = np.arange(len(poses))
    for axis, error, sigma in zip(AXES, *error_bands(poses, covariances, truth), strict=True):
        unit = axis.rpartition("_")[2]
        curves = {"error": (error, ESTIMATE), "two_sigma": (2 * sigma, TRUTH), "minus_two_sigma": (-2 * sigma, TRUTH)}
        for name, (values, color) in curves.items():
            record.log(f"error/{axis}/{name}", Series(values, steps, steps * STEP_NS, unit, color))


def error_bands(poses: Floats, covariances: Floats, truth: Floats) -> tuple[Floats, Floats]:
    """Errors (3, T) of poses in x, y (metres) and heading (degrees), and their standard deviations (3, T)."""
    units = np.array([1, 1, np.degrees(1)])
    sigma = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    return (units * errors(poses, truth)).T, (units * sigma).T


def outlines(poses: Floats, covariances: Floats) -> PointCloud:
    """Ellipses of two standard deviations about poses (N, 3) with covariances (N, 3, 3)."""
    points = ellipses(poses[:, :2], covariances[:, :2, :2], corners=72).reshape(-1, 2)
    return PointCloud(_at(points), np.tile(np.array(ESTIMATE, np.uint8), (len(points), 1)))


def line(poses: Floats, color: tuple[int, int, int]) -> PointCloud:
    """A dotted line along poses (T, 3)."""
    at = np.linspace(0, len(poses) - 1, DOTS * (len(poses) - 1) + 1)
    points = np.column_stack([np.interp(at, np.arange(len(poses)), axis) for axis in poses[:, :2].T])
    return PointCloud(_at(points), np.tile(np.array(color, np.uint8), (len(points), 1)))


def rays(start_m: Floats, ends_m: Floats, colors: Sequence[tuple[int, int, int]]) -> Graph:
    """Lines from one point (2,) to others (K, 2)."""
    return segments(np.stack([np.broadcast_to(start_m, ends_m.shape), ends_m], 1), colors)


def segments(ends_m: Floats, colors: Sequence[tuple[int, int, int]]) -> Graph:
    """Lines (M, 2, 2) from one end to the other."""
    edges = np.arange(2 * len(ends_m)).reshape(-1, 2)
    return Graph(_at(ends_m.reshape(-1, 2)), edges, np.array(colors, np.uint8).reshape(-1, 3))


def _at(rows: Floats) -> Floats:
    """The positions (N, 3) of rows (N, 2 or 3) that start with x and y, over the floor."""
    return np.column_stack([rows[:, :2], np.full(len(rows), RAISED_M)])
