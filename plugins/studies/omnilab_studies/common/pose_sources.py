"""The settings by which studies ask for images: from where, and how many."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from omnilab.api import NamedPath, PathPoses, Plan, PoseRequest, RandomPoses, RecordedPoses, Sensor
from omnilab.errors import ConfigError, did_you_mean
from omnilab.trajectory.files import read_trajectory


class Source(Enum):
    """Where images come from."""

    grid = "grid"  # a regular grid
    random = "random"  # poses drawn at random
    path = "path"  # a path that the world knows by name
    recorded = "recorded"  # all that was recorded


def layout_without_grid(
    source: Source, count: int, path: str, heading_step_deg: float | None, extent_m: tuple[float, float] | None,
    height_m: float | None, rng: np.random.Generator,
) -> PoseRequest:  # fmt: skip
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


def plan_of_way(sensor: Sensor, source: Source, path: str, height_m: float | None) -> Plan:
    """All that was recorded, in its order; or a path: of a file of poses, or one that the world knows by name."""
    if source is Source.recorded:
        return sensor.plan(RecordedPoses())
    if Path(path).suffix:
        return sensor.plan(PathPoses(read_trajectory(Path(path)).T_world_camera))
    return sensor.plan(NamedPath(path, height_m))


def changed(sensor: Sensor, where: str, settings: Mapping[str, Any]) -> Sensor:
    """A sensor with some of its settings changed; ConfigError, naming where they stand, for those it does not have."""
    known = [f.name for f in fields(sensor)]  # type: ignore[arg-type]
    for name in settings:
        if name not in known:
            raise ConfigError(
                f"{where} changes '{name}', which is no setting of the sensor; there is"
                f" {', '.join(known)}{did_you_mean(name, known)}"
            )
    try:
        return replace(sensor, **settings)  # type: ignore[type-var]
    except TypeError as error:
        raise ConfigError(f"{where}={dict(settings)} cannot be set ({error}); correct it") from error
