"""Simulated drives through scenarios: odometry and observations of views, without images."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from omnilab.api import Bools, Floats, Ints, check_settings, setting
from omnilab.errors import ConfigError
from omnilab.geometry import wrap_angle
from omnilab.limits import check_work
from omnilab.posegraph.graph import between, moved
from omnilab_studies.view_slam.scenarios import Scenario

GAP_RAD = (
    0.5  # standard deviation of the turn in a step that odometry has missed; of its translation: the step's length
)
SEEN_BYTES, WALL_BYTES = 26, 16  # of a view at a step, at least: kept of it, and while a wall is looked past


class Drive(NamedTuple):
    """T poses, T - 1 motions of odometry, N views in the order in which they are taken."""

    truth: Floats  # (T, 3)
    motions: Floats  # (T - 1, 3)
    covariances: Floats  # (T - 1, 3, 3)
    odometry: Floats  # (T, 3) the motions chained
    view_steps: Ints  # (N,) when each view is taken, ascending
    angles_rad: Floats  # (T, N, 2) as observed
    sigma_rad: float  # of both
    distance_m: Floats  # (T, N)
    open: Bools  # (T, N) whether it can be observed but for its distance: it was taken before, and no wall is between
    wrong: Bools  # (T, N) where the observation is that of another view

    def candidates(self, step: int, range_m: float) -> Ints:
        """The views (K,) within a range, in metres, that are observed at a step."""
        return np.flatnonzero(self.open[step] & (self.distance_m[step] < range_m))


@dataclass
class Drives:
    """Settings of simulated drives: laps, noise, mishaps."""

    laps: int = setting(2, at_least=1, at_most=10_000)  # views are taken on the first
    sigma_rad: float = setting(0.1, at_least=1e-6, at_most=1e6)  # of bearings and relative orientations
    nearest_m: float = setting(1.0, above=0)  # views nearer are not observed
    wrong_share: float = setting(0.0, at_least=0, below=1)  # of the observations are those of another view
    gap_share: float = setting(0.0, at_least=0, below=1)  # of the steps are missed by odometry
    halt_share: float = setting(0.0, at_least=0, below=1)  # of the poses, at which it stands still for a step

    def __post_init__(self) -> None:
        check_settings(self, "study.drives.")

    def drive(self, scenario: Scenario, views: int, rng: np.random.Generator) -> Drive:
        """One drive: views at the start and at random steps of the first lap, noise, mishaps."""
        truth = self._path(scenario, rng)
        motions = between(truth, np.column_stack([np.arange(len(truth) - 1), np.arange(1, len(truth))]))
        measured, covariances = self._odometry(scenario, motions, rng)
        steps = _view_steps(truth, len(scenario.lap), views, rng)
        true = _angles(truth, truth[steps])
        wrong = (rng.random(true.shape[:2]) < self.wrong_share) & (views > 1)
        other = (np.arange(views) + rng.integers(1, max(2, views), true.shape[:2])) % views
        observed = np.where(wrong[:, :, None], np.take_along_axis(true, other[:, :, None], axis=1), true)
        observed = wrap_angle(observed + self.sigma_rad * rng.standard_normal(true.shape))
        distance_m = np.linalg.norm(truth[:, None, :2] - truth[steps][:, :2], axis=2)
        far = (np.arange(len(truth))[:, None] > steps) & (distance_m >= self.nearest_m)
        clear = line_of_sight(truth[:, :2], truth[steps, :2], scenario.walls_m)
        return Drive(
            truth,
            measured,
            covariances,
            chained(truth[0], measured),
            steps,
            observed,
            self.sigma_rad,
            distance_m,
            far & clear,
            wrong,
        )

    def drives(self, scenario: Scenario, views: int, base: int, seeds: int, first: int = 0) -> list[Drive]:
        """A drive of each seed, from the `first`; ConfigError if they do not fit into memory."""
        seen = self.laps * len(scenario.lap) * views  # a view at a step
        check_work(
            f"{seeds} drives of {self.laps} laps with {views} views",
            "give fewer study.seeds, study.drives.laps or views",
            memory=seen * (SEEN_BYTES * seeds + WALL_BYTES * len(scenario.walls_m)),
        )
        return [self.drive(scenario, views, np.random.default_rng([base, k])) for k in range(first, first + seeds)]

    def _path(self, scenario: Scenario, rng: np.random.Generator) -> Floats:
        """Lap after lap, back to the start; with halts."""
        path = np.concatenate([np.tile(scenario.lap, (self.laps, 1)), scenario.lap[:1]])
        return np.repeat(path, 1 + (rng.random(len(path)) < self.halt_share), axis=0)

    def _odometry(self, scenario: Scenario, motions: Floats, rng: np.random.Generator) -> tuple[Floats, Floats]:
        """Measured motions (M, 3), covariances (M, 3, 3); a motion that was missed is zero, with a large covariance."""
        covariances = scenario.noise.covariances(motions)
        sigma = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
        measured = motions + sigma * rng.standard_normal(motions.shape)
        missed = rng.random(len(motions)) < self.gap_share
        measured[missed] = 0
        covariances[missed] = np.diag([scenario.step_m**2, scenario.step_m**2, GAP_RAD**2])
        return measured, covariances


def _view_steps(truth: Floats, lap: int, views: int, rng: np.random.Generator) -> Ints:
    """The first step and others (views,) at random on the first lap, each at another place; ascending.

    With more views the same ones are among them.
    """
    places = np.unique(truth[:, :2], axis=0, return_index=True)[1]
    order = rng.permutation(np.sort(places)[1:lap])
    if views > lap:
        raise ConfigError(f"{views} views do not fit on a lap of {lap} steps; give fewer")
    return np.sort(np.append(0, order[: views - 1]))


def _angles(robots: Floats, views: Floats) -> Floats:
    """Bearings and relative orientations (T, N, 2) of views (N, 3) from robots (T, 3) (Gil et al., 2012, eq. 12)."""
    dx, dy = (views[:, :2] - robots[:, None, :2]).transpose(2, 0, 1)
    heading = robots[:, 2, None]
    return wrap_angle(np.stack([np.arctan2(dy, dx) - heading, views[:, 2] - heading], -1))


def line_of_sight(one_m: Floats, other_m: Floats, walls_m: Floats) -> Bools:
    """Which points (T, 2) see which others (N, 2) past walls (W, 2, 2), (T, N). A wall that is touched blocks."""
    p, q = one_m[:, None, None], other_m[None, :, None]
    a, b = walls_m[:, 0], walls_m[:, 1]
    apart = _side(p, q, a) * _side(p, q, b) <= 0
    across = _side(a, b, p) * _side(a, b, q) <= 0
    # all four on one line: apart unless their extents overlap
    overlap = (np.maximum(p, q) >= np.minimum(a, b)) & (np.minimum(p, q) <= np.maximum(a, b))
    return np.asarray(~(apart & across & overlap.all(axis=-1)).any(axis=-1))


def _side(a: Floats, b: Floats, c: Floats) -> Floats:
    """Above 0 where c is to the left of the line from a to b."""
    return np.asarray(
        (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])
    )


def chained(start: Floats, motions: Floats) -> Floats:
    """Poses (M + 1, 3) from a first (3,) along motions (M, 3)."""
    poses = [start]
    for motion in motions:
        poses.append(moved(poses[-1], motion))
    return np.array(poses)
