"""A robot that maps views with a filter: which views it sees in an image, and when it takes a new one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Bools, Floats, Ints, Motion, Unusable, ViewFilter
from omnilab.errors import ConfigError

START_VARIANCE = 1e-6  # m², rad²: the first pose is known
Relate = Callable[[int, int], Motion]  # how to get from one image to another, by their numbers


@dataclass
class Association:
    """When an image shows a view, and when it becomes one (Gil et al., 2012, 4, eq. 13 and 21)."""

    range_m: float = 2.0  # delta_D: views that the robot believes to be farther away are not looked for
    nearest_m: float = 0.25  # nearer ones are not observed: their bearing is hardly defined
    candidates: int = 3  # views that an image is matched with, at most: the nearest, and those that can be observed
    similarity: float = 0.5  # R: an image that is less alike to all of them becomes a view
    least: int = 25  # matches that agree, or a view is not seen
    sigma_deg: float = 0.5  # standard deviation of both angles besides what the matches tell

    def __post_init__(self) -> None:
        if not 0 <= self.nearest_m < self.range_m:
            raise ConfigError(
                f"study.views.nearest_m={self.nearest_m:g}, range_m={self.range_m:g} leave no view to be seen; give 0 or more,"
                " and a larger range"
            )
        if self.candidates < 1 or self.least < 4 or not 0 < self.similarity <= 1 or not self.sigma_deg > 0:
            raise ConfigError(
                f"study.views.candidates={self.candidates}, least={self.least}, similarity={self.similarity:g}, sigma_deg="
                f"{self.sigma_deg:g} see nothing; give 1 view and 4 matches or more, a similarity up to 1, degrees above 0"
            )


class Looked(NamedTuple):
    """What a robot saw in one image."""

    views: Ints  # (K,) that it observed
    angles_rad: Floats  # (K, 2) bearing and relative orientation
    believed: Bools  # (K,) which of them the filter took
    compared: dict[int, Motion]  # views that the image was matched with
    new: int | None  # the view that it became
    warnings: list[str]


class ViewMapper:
    """One filter on its way: its map, and which image each of its views is."""

    def __init__(self, view_filter: ViewFilter, settings: Association, relate: Relate, first_pose: Floats) -> None:
        self.map = view_filter.begin(first_pose, START_VARIANCE * np.eye(3))
        self.images: list[int] = []  # of each view
        self.poses = [self.map.pose()]
        self._settings, self._relate = settings, relate

    def know(self, image: int, pose: Floats, covariance: Floats) -> None:
        """A view from before, at a pose (3,) known with a covariance (3, 3)."""
        self.map.know_view(pose, covariance)
        self.images.append(image)

    def take(self, image: int, look: Any, motion: Floats | None, covariance: Floats | None) -> Looked:
        """One more image, after the motion (3,) that odometry tells with a covariance (3, 3); neither at the first."""
        said = [] if motion is None or covariance is None else list(self.map.predict(motion, covariance))
        apart = np.linalg.norm(self.map.views()[:, :2] - self.map.pose()[0][:2], axis=1)
        compared = {} if isinstance(look, Unusable) else self._compared(image, apart)
        views, angles, spreads = self._seen(compared, apart)
        believed = np.zeros(0, bool)
        if len(views):
            believed, problems = self.map.observe(views, angles, spreads)
            said += problems
        new = None
        alike = [similarity(told) for told in compared.values()]
        if not isinstance(look, Unusable) and max(alike, default=0.0) < self._settings.similarity:
            new = self.map.add_view()
            self.images.append(image)
        if motion is not None:
            self.poses.append(self.map.pose())
        return Looked(views, angles, believed, compared, new, said)

    def _compared(self, image: int, apart: Floats) -> dict[int, Motion]:
        """The relative pose of the image and each of the nearest views within the range, by how far views are (V,).

        Of those that are too near to be observed only the nearest, which tells whether the image should become a view.
        """
        s, order = self._settings, np.argsort(apart, kind="stable")
        useful = (apart[order] <= s.range_m) & ((apart[order] >= s.nearest_m) | (np.arange(len(order)) == 0))
        return {int(view): self._relate(image, self.images[view]) for view in order[useful][: s.candidates]}

    def _seen(self, compared: dict[int, Motion], apart: Floats) -> tuple[Ints, Floats, Floats]:
        """Views (K,) that enough matches show, their angles (K, 2) and covariances (K, 2, 2)."""
        s, found = self._settings, []
        for view, told in compared.items():
            if not told.failed and agreeing(told) >= s.least and apart[view] >= s.nearest_m:
                found.append((view, *angles_of(told, np.deg2rad(s.sigma_deg))))
        return (
            np.array([view for view, _, _ in found], int),
            np.array([angles for _, angles, _ in found]).reshape(-1, 2),
            np.array([spread for _, _, spread in found]).reshape(-1, 2, 2),
        )


def similarity(told: Motion) -> float:
    """R = 2 K / (n_A + n_B): matches that agree, over features in both images (Gil et al., eq. 13)."""
    return 2 * agreeing(told) / told.features if told.features else 0.0


def agreeing(told: Motion) -> int:
    """How many matches agree with a motion."""
    return 0 if told.agree is None else int(told.agree.sum())


def angles_of(told: Motion, sigma_rad: float) -> tuple[Floats, Floats]:
    """Bearing and relative orientation (2,) of where a motion leads, and their covariance (2, 2)."""
    x, y, turn = told.vector
    J = np.array([[-y, x, 0], [0, 0, x * x + y * y]]) / (x * x + y * y)
    return np.array([np.arctan2(y, x), turn]), J @ told.covariance @ J.T + sigma_rad**2 * np.eye(2)
