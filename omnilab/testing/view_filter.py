"""The conformance check of view filters."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from omnilab.api import Floats
from omnilab.geometry import wrap_angle
from omnilab.posegraph.graph import between
from omnilab.testing.common import expect
from omnilab.testing.rules import Trial, Work, conform, rule


def _circle(count: int) -> Floats:
    """Poses (count, 3) round a circle of 2 m, headed along it; the last is the first."""
    angle = np.linspace(0, 2 * np.pi, count)
    return np.column_stack([2 * np.cos(angle), 2 * np.sin(angle), wrap_angle(angle + np.pi / 2)])


CIRCLE, SMALL = _circle(25), np.diag([1e-4, 1e-4, 1e-4])


def check_view_filter(view_filter: Any, near_m: float | None = None) -> None:
    """A circle without noise, with views seen truly, is kept exactly; a wrong observation is not believed; pickles.

    Covariances stay symmetric and positive; views are numbered as they come. Known views locate the robot. `near_m`
    is how exactly, a millimetre, or 0.1 m of a filter that draws samples, which one with a setting `seed` is taken to do.
    One that observes landmarks gets landmarks.
    """
    conform(trial_of(view_filter, near_m))


def trial_of(view_filter: Any, near_m: float | None = None) -> Trial:
    """The trial of a filter of views, or of one that observes landmarks."""
    landmarks = getattr(view_filter, "observes", "views") == "landmarks"
    return (LandmarkTrial if landmarks else ViewTrial)(view_filter, near_m)


class FilterTrial(Trial):
    """A view filter, and how near to the truth it must come."""

    kind = "view_filter"

    def __init__(self, view_filter: Any, near_m: float | None = None) -> None:
        super().__init__(view_filter)
        sampled = hasattr(view_filter, "seed")
        self.near_m = (0.1 if sampled else 1e-3) if near_m is None else near_m


class ViewTrial(FilterTrial):
    """Views taken on the way round a circle without noise."""

    def work(self) -> Work:
        return Work(lambda: self._driven(self.given), len(CIRCLE) - 1, "step")

    @cached_property
    def driven(self) -> tuple[Any, list[Floats]]:
        """The map after the drive, and the poses of its views."""
        return self._driven(self.component)

    def _driven(self, view_filter: Any) -> tuple[Any, list[Floats]]:
        found, kept = view_filter.begin(CIRCLE[0], 1e-6 * np.eye(3)), list[Floats]()
        for i in range(1, len(CIRCLE)):
            motion = between(CIRCLE, np.array([[i - 1, i]]))[0]
            expect(not found.predict(motion, SMALL), "a plain step goes wrong")
            far = [k for k, view in enumerate(kept) if np.hypot(*(view - CIRCLE[i])[:2]) > 0.7]
            if far:
                seen = np.array([_angles(CIRCLE[i], kept[k]) for k in far])
                believed, warnings = found.observe(np.array(far), seen, np.tile(1e-4 * np.eye(2), (len(far), 1, 1)))
                expect(np.shape(believed) == (len(far),), "it does not say of each observation whether it is believed")
                expect(bool(np.all(believed)) and not warnings, f"true observations are not believed: {warnings}")
            if i % 4 == 0:
                expect(found.add_view() == len(kept), "views are not numbered as they come, from 0")
                kept.append(CIRCLE[i])
        return found, kept

    @rule("believes true observations, and keeps robot and views where they are")
    def keeps(self) -> None:
        found, kept = self.driven
        near = bool(np.allclose(found.views()[:, :2], np.array(kept)[:, :2], atol=self.near_m))
        expect(near, "views are not where they were taken; bearing is atan2(y_i - y, x_i - x) - heading")
        expect(bool(np.allclose(found.pose()[0][:2], CIRCLE[-1, :2], atol=self.near_m)), "the robot is not where it is")

    @rule("has symmetric, positive covariances")
    def covariances(self) -> None:
        found, _ = self.driven
        for one in (found.pose()[1], *found.view_covariances()):
            positive = bool(np.allclose(one, one.T) and np.linalg.eigvalsh(one)[0] > 0)
            expect(positive, "a covariance is not positive definite; use Joseph's form, or square roots")

    @rule("is located by views whose poses are known")
    def known_views(self) -> None:
        _check_known_view(self.component, self.near_m)

    @rule("does not believe an observation that is off by a radian, and gives the true trajectory at the end")
    def wrong_observation(self) -> None:
        found, kept = self._driven(self.component)
        wrong = _angles(CIRCLE[-1], kept[2]) + np.array([1.5, -1.0])
        believed, _ = found.observe(np.array([2]), wrong[None], 1e-4 * np.eye(2)[None])
        expect(
            not believed[0], "an observation that is off by a radian is believed; gate innovations by their covariance"
        )
        trajectory = found.finish()
        expect(trajectory.shape == CIRCLE.shape, f"the trajectory has shape {trajectory.shape}, not (T, 3)")
        near = bool(np.allclose(trajectory[:, :2], CIRCLE[:, :2], atol=self.near_m))
        expect(near, "the trajectory is not the true one")


class LandmarkTrial(FilterTrial):
    """Landmarks round a circle, seen truly in small steps."""

    def __init__(self, view_filter: Any, near_m: float | None = None) -> None:
        super().__init__(view_filter, near_m)
        around = np.linspace(0, 2 * np.pi, 9)[:-1]
        self.points = np.column_stack([4 * np.cos(around), 3 * np.sin(around), np.cos(3 * around)])
        self.fine, self.truth = np.tile(1e-4 * np.eye(2), (len(around), 1, 1)), _circle(97)

    def work(self) -> Work:
        return Work(lambda: self._driven(self.given), len(self.truth) - 1, "step")

    @cached_property
    def driven(self) -> Any:
        return self._driven(self.component)

    def _driven(self, view_filter: Any) -> Any:
        found, truth, numbers = (
            view_filter.begin(self.truth[0], 1e-6 * np.eye(3)),
            self.truth,
            np.arange(len(self.fine)),
        )
        expect([found.add_view() for _ in numbers] == list(numbers), "landmarks are not numbered as they come, from 0")
        for i in range(len(truth)):
            if i:
                motion = between(truth, np.array([[i - 1, i]]))[0]
                expect(not found.predict(motion, 3e-5 * np.eye(3)), "a plain step goes wrong")
            seen = np.array([_direction(truth[i], point) for point in self.points])
            believed, warnings = found.observe(numbers, seen, self.fine)
            expect(bool(np.all(believed)) and not warnings, f"true observations are not believed: {warnings}")
        return found

    @rule("believes true observations, and keeps robot and landmarks where they are")
    def keeps(self) -> None:
        found, near_m = self.driven, self.near_m
        expect(bool(np.allclose(found.views(), self.points, atol=10 * near_m)), "landmarks are not where they are")
        near = bool(np.allclose(found.finish()[:, :2], self.truth[:, :2], atol=5 * near_m))
        expect(near, "the trajectory is not the true one")

    @rule("has symmetric, positive covariances")
    def covariances(self) -> None:
        for one in (self.driven.pose()[1], *self.driven.view_covariances()):
            positive = bool(np.allclose(one, one.T) and np.linalg.eigvalsh(one)[0] > 0)
            expect(positive, "a covariance is not positive definite; use Joseph's form, or square roots")

    @rule("does not believe an observation that is off by half a radian")
    def wrong_observation(self) -> None:
        wrong = _direction(self.truth[-1], self.points[2])[None] + 0.5
        believed, _ = self._driven(self.component).observe(np.array([2]), wrong, self.fine[:1])
        expect(not believed[0], "an observation that is off by half a radian is believed; gate innovations")

    @rule("is located by landmarks whose positions are known")
    def known_landmarks(self) -> None:
        lost = self.component.begin(np.array([0.1, -0.1, 0.02]), np.diag([0.1, 0.1, 0.02]))
        for point in self.points:
            lost.know_view(point, 1e-6 * np.eye(3))
        seen = np.array([_direction(np.zeros(3), point) for point in self.points])
        for _ in range(3):
            lost.observe(np.arange(len(self.points)), seen, self.fine)
        expect(bool(np.allclose(lost.pose()[0], 0, atol=0.01)), "known landmarks do not locate the robot")


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


def _direction(robot: Floats, point: Floats) -> Floats:
    """Azimuth and elevation (2,) of a point (3,), z over the camera, from a robot's pose (3,)."""
    x, y = point[:2] - robot[:2]
    return np.asarray([wrap_angle(np.arctan2(y, x) - robot[2]), np.arctan2(point[2], np.hypot(x, y))])


def _angles(robot: Floats, view: Floats) -> Floats:
    """Bearing and relative orientation (2,) of a view (3,) from a robot's pose (3,)."""
    x, y = (view - robot)[:2]
    return np.asarray(wrap_angle([np.arctan2(y, x) - robot[2], view[2] - robot[2]]))
