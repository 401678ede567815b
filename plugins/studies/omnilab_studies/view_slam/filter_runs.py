"""A view filter on a simulated drive: its estimates at each step, and their errors."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from omnilab.api import Bools, Floats, Ints, ViewFilter, ViewMap
from omnilab.trajectory.evaluation import rms
from omnilab_studies.view_slam.consistency import errors, nees
from omnilab_studies.view_slam.drives import Drive

START_VARIANCE = 1e-6  # m², rad²: the first pose is known
Watch = Callable[[int, ViewMap, Ints, Bools], None]  # step, map, the views that are observed, and which are believed


class FilterTrace(NamedTuple):
    """A filter's T poses, and its observations."""

    poses: Floats  # (T, 3) online: each when it was the last
    covariances: Floats  # (T, 3, 3)
    final_poses: Floats  # (T, 3) of the trajectory at the end
    seconds: Floats  # (T,) of each step
    observed: int
    gated: int  # true observations that it did not believe
    wrong: int  # observations of another view
    wrong_gated: int  # and those of them that it did not believe
    warnings: list[str]


class FilterEstimate(NamedTuple):
    """A filter's estimate of a trajectory of T poses and a map of N views, or landmarks."""

    poses: Floats  # (T, 3) online
    covariances: Floats  # (T, 3, 3)
    views: Floats  # (N, 3) at the end
    view_covariances: Floats  # (N, 3, 3)
    observes: str = "views"  # or landmarks


def run_filter(view_filter: ViewFilter, drive: Drive, range_m: float, watch: Watch | None = None) -> FilterTrace:
    """Predict, observe, take views; step by step. `watch` is called after each."""
    view_map = view_filter.begin(drive.truth[0], START_VARIANCE * np.eye(3))
    R = drive.sigma_rad**2 * np.eye(2)
    taken, poses, seconds, warnings = set(drive.view_steps.tolist()), [view_map.pose()], [0.0], list[str]()
    observed, gated, wrong, wrong_gated = 0, 0, 0, 0
    if 0 in taken:
        view_map.add_view()
    for step in range(1, len(drive.truth)):
        views = drive.candidates(step, range_m)
        believed, start = np.zeros(0, bool), time.perf_counter()
        warnings += view_map.predict(drive.motions[step - 1], drive.covariances[step - 1])
        if len(views):
            believed, more = view_map.observe(views, drive.angles_rad[step, views], np.tile(R, (len(views), 1, 1)))
            warnings += more
            false = drive.wrong[step, views]
            observed, wrong = observed + len(views), wrong + int(false.sum())
            gated, wrong_gated = gated + int((~believed & ~false).sum()), wrong_gated + int((~believed & false).sum())
        if step in taken:
            view_map.add_view()
        poses.append(view_map.pose())
        seconds.append(time.perf_counter() - start)
        if watch:
            watch(step, view_map, views, believed)
    online, covariances = (np.array(each) for each in zip(*poses, strict=True))
    final = view_map.finish()
    return FilterTrace(online, covariances, final, np.array(seconds), observed, gated, wrong, wrong_gated, warnings)


def position_rms(poses: Floats, truth: Floats) -> float:
    """Root mean square of the distances between positions of poses (T, 3), in metres; nothing is aligned."""
    return rms(np.linalg.norm(poses[:, :2] - truth[:, :2], axis=1))


def trace_nees(trace: FilterTrace, drive: Drive) -> Floats:
    """NEES (T - 1,) of x, y and heading, three degrees of freedom, after the first pose, which is known."""
    return nees(errors(trace.poses, drive.truth)[1:], trace.covariances[1:])
