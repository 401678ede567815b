"""Settings of a grid of places: checked, and as a pose request."""

from __future__ import annotations

from collections.abc import Sequence

from omnilab.api import GridPoses
from omnilab.errors import ConfigError


def check_step_or_every(step_m: float | None, every: int | None) -> None:
    """ConfigError unless one of the two is given."""
    if (step_m is None) == (every is None):
        raise ConfigError(f"study.step_m={step_m} and study.every={every}: give one of them, and null for the other")


def extent_of(extent_m: Sequence[float] | None) -> tuple[float, float] | None:
    """The setting `extent_m` as lengths along x and y; None: all that the sensor covers."""
    return None if extent_m is None else (extent_m[0], extent_m[1])


def grid_poses(
    step_m: float | None, every: int | None, extent_m: Sequence[float] | None, height_m: float | None
) -> GridPoses:
    """The grid that a study's settings describe."""
    return GridPoses(step_m, every, extent_of(extent_m), height_m)
