"""The settings by which studies ask for images: from where, and how many."""

from __future__ import annotations

from enum import Enum

import numpy as np

from omnilab.api import Layout, NamedPath, RandomPoses, RecordedPoses
from omnilab.errors import ConfigError


class Source(Enum):
    """Where images come from."""

    grid = "grid"  # a regular grid
    random = "random"  # poses drawn at random
    path = "path"  # a path that the world knows by name
    recorded = "recorded"  # all that was recorded


def layout_without_grid(
    source: Source, count: int, path: str, heading_step_deg: float | None, extent_m: tuple[float, float] | None,
    height_m: float | None, rng: np.random.Generator,
) -> Layout:  # fmt: skip
    """The layout that a study's settings describe, where it is no grid; draws one number whatever it is."""
    seed = int(rng.integers(2**32))
    if source is Source.recorded:
        return RecordedPoses()
    if source is Source.path:
        return NamedPath(path, height_m)
    if source is Source.random:
        step = None if heading_step_deg is None else float(np.deg2rad(heading_step_deg))
        return RandomPoses(count, seed, step, extent_m, height_m)
    raise ConfigError(f"queries={source.value} would be the places themselves; give random, path or recorded")
