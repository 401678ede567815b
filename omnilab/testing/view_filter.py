"""The conformance check of view filters."""

from __future__ import annotations

from typing import Any

import numpy as np

from omnilab.api import Floats
from omnilab.geometry import wrap_angle
from omnilab.posegraph.graph import between
from omnilab.testing.common import check_common, expect


def check_view_filter(view_filter: Any, near_m: float = 1e-3) -> None:
    """A circle without noise, with views seen truly, is kept exactly; a wrong observation is not believed; pickles.

    Covariances stay symmetric and positive; views are numbered as they come. Known views locate the robot. `near_m`
    is how exactly: a filter that draws samples is as exact as they are many. One that observes landmarks gets landmarks.
    """
    view_filter = check_common("view_filter", view_filter)
    if getattr(view_filter, "observes", "views") == "landmarks":
        _check_landmarks(view_filter, near_m)
        return
    truth, small = _circle(25), np.diag([1e-4, 1e-4, 1e-4])
    _check_known_view(view_filter, near_m)
    found = view_filter.begin(truth[0], 1e-6 * np.eye(3))
    kept: list[Floats] = []
    for i in range(1, len(truth)):
        motion = between(truth, np.array([[i - 1, i]]))[0]
        expect(not found.predict(motion, small), "a plain step goes wrong")
        far = [k for k, view in enumerate(kept) if np.hypot(*(view - truth[i])[:2]) > 0.7]
        if far:
            seen = np.array([_angles(truth[i], kept[k]) for k in far])
            believed, warnings = found.observe(np.array(far), seen, np.tile(1e-4 * np.eye(2), (len(far), 1, 1)))
            expect(np.shape(believed) == (len(far),), "it does not say of each observation whether it is believed")
            expect(bool(np.all(believed)) and not warnings, f"true observations are not believed: {warnings}")
        if i % 4 == 0:
            expect(found.add_view() == len(kept), "views are not numbered as they come")
            kept.append(truth[i])
    views, spreads = found.views(), found.view_covariances()
    pose, spread = found.pose()
    expect(bool(np.allclose(views[:, :2], np.array(kept)[:, :2], atol=near_m)), "views are not where they were taken")
    expect(bool(np.allclose(pose[:2], truth[-1, :2], atol=near_m)), "the robot is not where it is")
    for one in (spread, *spreads):
        expect(
            bool(np.allclose(one, one.T) and np.linalg.eigvalsh(one)[0] > 0), "a covariance is not positive definite"
        )
    wrong = _angles(truth[-1], kept[2]) + np.array([1.5, -1.0])
    believed, _ = found.observe(np.array([2]), wrong[None], 1e-4 * np.eye(2)[None])
    expect(not believed[0], "an observation that is off by a radian is believed")
    trajectory = found.finish()
    expect(trajectory.shape == truth.shape, f"the trajectory has shape {trajectory.shape}, not (T, 3)")
    expect(bool(np.allclose(trajectory[:, :2], truth[:, :2], atol=near_m)), "the trajectory is not the true one")


def _check_known_view(view_filter: Any, near_m: float) -> None:
    """Known views stay where they are known to be, and correct a robot that is unsure of its pose."""
    known, small = np.array([[3.0, 2, 0.5], [3, -2, -0.5]]), np.diag([1e-6, 1e-6, 1e-6])
    found = view_filter.begin(np.array([0.1, -0.1, 0.02]), np.diag([0.1, 0.1, 0.02]))
    numbers = [found.know_view(pose, small) for pose in known]
    expect(numbers == [0, 1], "known views are not numbered as they come")
    expect(bool(np.allclose(found.views(), known)), "known views are not where they are known to be")
    for one in found.view_covariances():
        expect(bool(np.allclose(one, small)), "the covariance of known views is another")
    seen = np.array([_angles(np.zeros(3), pose) for pose in known])
    for _ in range(3):
        found.observe(np.arange(2), seen, np.tile(1e-6 * np.eye(2), (2, 1, 1)))
    expect(bool(np.allclose(found.pose()[0], 0, atol=max(0.01, near_m))), "known views do not locate the robot")
    expect(len(found.finish()) == 1, "known views are taken for poses of the trajectory")


def _circle(count: int) -> Floats:
    """Poses (count, 3) round a circle of 2 m, headed along it; the last is the first."""
    angle = np.linspace(0, 2 * np.pi, count)
    return np.column_stack([2 * np.cos(angle), 2 * np.sin(angle), wrap_angle(angle + np.pi / 2)])


def _check_landmarks(view_filter: Any, near_m: float) -> None:
    """Landmarks round a circle, seen truly in small steps, become known, and keep the robot where it is."""
    truth, small, around = _circle(97), 3e-5 * np.eye(3), np.linspace(0, 2 * np.pi, 9)[:-1]
    points = np.column_stack([4 * np.cos(around), 3 * np.sin(around), np.cos(3 * around)])
    found, fine = view_filter.begin(truth[0], 1e-6 * np.eye(3)), np.tile(1e-4 * np.eye(2), (len(points), 1, 1))
    expect([found.add_view() for _ in points] == list(range(len(points))), "landmarks are not numbered as they come")
    for i in range(len(truth)):
        if i:
            motion = between(truth, np.array([[i - 1, i]]))[0]
            expect(not found.predict(motion, small), "a plain step goes wrong")
        seen = np.array([_direction(truth[i], point) for point in points])
        believed, warnings = found.observe(np.arange(len(points)), seen, fine)
        expect(bool(np.all(believed)) and not warnings, f"true observations are not believed: {warnings}")
    expect(bool(np.allclose(found.views(), points, atol=10 * near_m)), "landmarks are not where they are")
    expect(
        bool(np.allclose(found.finish()[:, :2], truth[:, :2], atol=5 * near_m)), "the trajectory is not the true one"
    )
    for one in (found.pose()[1], *found.view_covariances()):
        expect(
            bool(np.allclose(one, one.T) and np.linalg.eigvalsh(one)[0] > 0), "a covariance is not positive definite"
        )
    believed, _ = found.observe(np.array([2]), _direction(truth[-1], points[2])[None] + 0.5, fine[:1])
    expect(not believed[0], "an observation that is off by half a radian is believed")
    lost = view_filter.begin(np.array([0.1, -0.1, 0.02]), np.diag([0.1, 0.1, 0.02]))
    for point in points:
        lost.know_view(point, 1e-6 * np.eye(3))
    for _ in range(3):
        lost.observe(np.arange(len(points)), np.array([_direction(np.zeros(3), point) for point in points]), fine)
    expect(bool(np.allclose(lost.pose()[0], 0, atol=0.01)), "known landmarks do not locate the robot")


def _direction(robot: Floats, point: Floats) -> Floats:
    """Azimuth and elevation (2,) of a point (3,), z over the camera, from a robot's pose (3,)."""
    x, y = point[:2] - robot[:2]
    return np.asarray([wrap_angle(np.arctan2(y, x) - robot[2]), np.arctan2(point[2], np.hypot(x, y))])


def _angles(robot: Floats, view: Floats) -> Floats:
    """Bearing and relative orientation (2,) of a view (3,) from a robot's pose (3,)."""
    x, y = (view - robot)[:2]
    return np.asarray(wrap_angle([np.arctan2(y, x) - robot[2], view[2] - robot[2]]))
