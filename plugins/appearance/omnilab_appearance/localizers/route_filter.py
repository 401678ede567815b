"""Localisation of a sequence along a route, with the speed as part of the state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from omnilab.api import Distance, Estimates, Floats, Ints, Places, Signatures, check_settings, setting
from omnilab.errors import DataError
from omnilab.geometry import heading_of, wrap_angle
from omnilab.limits import check_work
from omnilab_appearance.localizers.nearest import Nearest

PER_STEP = 4  # cells of the grid in one step of the map
AROUND = 2.0  # steps about the likeliest cell that the estimate is the mean of
FLOOR = 1e-30
ROUNDING = 1e-6  # of a cell


@dataclass
class RouteFilterIndex:
    """The map as a route, and the belief after the last query."""

    places: Places
    distance: Distance
    prepared: Any
    step_m: float  # of the map, along the route
    along_m: Floats  # (P,) arc length of the places
    cells_m: Floats  # (C,) of the grid
    belief: Floats | None = None  # (C, V) over arc length and speed, its sum is 1; None before the first query


@dataclass
class RouteFilter:
    """A histogram filter over position and speed along a route (Thrun, Burgard and Fox, 2005, table 4.1).

    The places are a route in the map's order, the queries one drive along it, either way and at its own pace. The state is
    the arc length, on a grid of a quarter of the map's step, and the speed, which lasts from one query to the next but for
    a normal change of standard deviation `acceleration`. `bayes_filter` has no speed: a camera that moves more than its
    `motion_m` a query is always behind there. Odometry, where there is one, gives the speed of each query.

    The likelihood of places is `bayes_filter`'s, exp(-certainty (d - min) / (median - min)), and linear in its logarithm
    between two. The position is the mean of the belief within two steps of its peak: it lies between places. The distances
    are -log of the belief. A share `lost` of the belief is spread evenly.
    """

    fastest: float = setting(4.0, at_least=0.25, at_most=1000)  # steps of the map between two queries, either way
    acceleration: float = setting(0.5, at_least=0.01, at_most=1000)  # change of the speed, steps of the map per query
    certainty: float = setting(
        12.0, above=0, at_most=1e6
    )  # log likelihood ratio of the most alike place to one at the median distance
    lost: float = setting(0.01, above=0, below=1)  # share of the belief that is spread evenly

    def __post_init__(self) -> None:
        check_settings(self)

    def prepare(self, places: Places, distance: Distance) -> RouteFilterIndex:
        """The route, before the first query."""
        _, _, prepared = Nearest().prepare(places, distance)
        assert places.T_world_camera is not None
        steps_m = np.linalg.norm(np.diff(places.T_world_camera[:, :3, 3], axis=0), axis=1)
        if not (steps_m > 0).any():
            raise DataError(f"the map's {len(places)} places are at one position, which is no route; give places apart")
        step_m, along_m = float(np.median(steps_m[steps_m > 0])), np.append(0.0, np.cumsum(steps_m))
        count = int(np.ceil(along_m[-1] / step_m * PER_STEP - ROUNDING)) + 1
        check_work(
            f"a route of {along_m[-1]:.3g} m in cells of a quarter of its step, {step_m:.3g} m,",
            "give places in the route's order, or fewer localizer.fastest",
            memory=24.0 * count * len(self._speeds),
        )
        return RouteFilterIndex(places, distance, prepared, step_m, along_m, np.arange(count) * step_m / PER_STEP)

    def locate(self, queries: Signatures, index: RouteFilterIndex) -> Estimates:
        """As `track`, with unknown motion."""
        return self.track(queries, index, np.full((len(queries), 3), np.nan))

    def track(self, queries: Signatures, index: RouteFilterIndex, motion: Floats) -> Estimates:
        """Filter queries in order; motion (Q, 3) forward, left, counter-clockwise up to each, NaN where unknown."""
        assert index.places.T_world_camera is not None
        match = index.distance.match(queries, index.prepared)
        field = np.empty(match.distance.shape, np.float32)
        along_m = np.empty(len(queries))
        for q, distance in enumerate(match.distance.astype(float)):
            belief = self._predict(index, motion[q]) * self._likelihood(distance, index)[:, None]
            index.belief = belief / belief.sum()
            where = index.belief.sum(axis=1)
            along_m[q] = _mean_about_peak(where, index)
            field[q] = -np.log(np.maximum(np.interp(index.along_m, index.cells_m, where), FLOOR))
        best, every = field.argmin(axis=1), np.arange(len(field))
        poses, heading = index.places.T_world_camera, None
        if match.rotation_rad is not None:
            heading = wrap_angle(heading_of(poses[best]) + match.rotation_rad[every, best])
        position_m = np.column_stack([np.interp(along_m, index.along_m, poses[:, axis, 3]) for axis in range(3)])
        return Estimates(best, field[every, best], position_m, heading, field)

    @property
    def _speeds(self) -> Ints:
        """Speeds (V,) in cells per query."""
        most = max(1, round(self.fastest * PER_STEP))
        return np.arange(-most, most + 1, dtype=np.int64)

    def _predict(self, index: RouteFilterIndex, motion: Floats) -> Floats:
        """The belief (C, V) with speeds changed, and moved by them."""
        speeds = self._speeds
        if index.belief is None:
            return np.full((len(index.cells_m), len(speeds)), 1 / (len(index.cells_m) * len(speeds)))
        before = speeds[:, None]
        if np.isfinite(motion).all():  # the speed is measured
            before = np.sign(before) * np.hypot(motion[0], motion[1]) / index.step_m * PER_STEP
        change = np.exp(-0.5 * ((before - speeds) / (self.acceleration * PER_STEP)) ** 2)
        changed = index.belief @ (change / np.maximum(change.sum(axis=1, keepdims=True), FLOOR))
        moved = np.zeros_like(changed)
        for column, speed in enumerate(speeds):
            ahead, behind = (min(max(by, 0), len(moved)) for by in (speed, -speed))  # off a short route: nothing stays
            moved[ahead : len(moved) - behind, column] = changed[behind : len(moved) - ahead, column]
        share = (1 - self.lost) / max(moved.sum(), FLOOR)
        return np.asarray(share * moved + self.lost / moved.size)

    def _likelihood(self, distance: Floats, index: RouteFilterIndex) -> Floats:
        """The likelihood (C,) of cells, up to a factor, from the distances (P,); uniform where all are equal."""
        above = distance - distance.min()
        middling = np.median(above)
        logarithm = -self.certainty * above / middling if middling > 0 else np.where(above > 0, np.log(FLOOR), 0.0)
        return np.exp(np.interp(index.cells_m, index.along_m, logarithm))


def _mean_about_peak(belief: Floats, index: RouteFilterIndex) -> float:
    """Mean arc length of the belief (C,) about its largest value."""
    near = np.abs(index.cells_m - index.cells_m[belief.argmax()]) <= AROUND * index.step_m
    return float(belief[near] @ index.cells_m[near] / belief[near].sum())
