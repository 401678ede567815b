"""Settings of where images come from: random poses, a path, a recording, another setting of the sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from enum import Enum
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from omnilab.api import NamedPath, PathPoses, Plan, PoseRequest, RandomPoses, RecordedPoses, Sensor
from omnilab.errors import ConfigError, did_you_mean
from omnilab.trajectory import plausibility
from omnilab.trajectory.files import read_trajectory
from omnilab_studies.common.grids import extent_of

C = TypeVar("C")  # a component


class Source(Enum):
    """Where images come from."""

    grid = "grid"  # a regular grid
    random = "random"  # poses drawn at random
    path = "path"  # a path that the world knows by name
    recorded = "recorded"  # all that was recorded


def check_is_trajectory(source: Source) -> None:
    """ConfigError for a source whose poses are in no order: those of a grid, or at random."""
    if source not in {Source.path, Source.recorded}:
        raise ConfigError(f"study.images={source.value} makes no trajectory; give path or recorded")


def random_poses(
    count: int, seed: int, heading_step_deg: float | None, extent_m: Sequence[float] | None, height_m: float | None
) -> RandomPoses:
    """Random poses as a study's settings describe them; headings are multiples of the step, or any without one."""
    step = None if heading_step_deg is None else float(np.deg2rad(heading_step_deg))
    return RandomPoses(count, seed, step, extent_of(extent_m), height_m)


def query_poses(
    source: Source, count: int, path: str, heading_step_deg: float | None, extent_m: Sequence[float] | None,
    height_m: float | None, rng: np.random.Generator,
) -> PoseRequest:  # fmt: skip
    """The query poses that a study's settings describe; draws one number from `rng`, whatever the source is.

    ConfigError for a grid: its poses are the places.
    """
    seed = int(rng.integers(2**32))
    if source is Source.recorded:
        return RecordedPoses()
    if source is Source.path:
        return NamedPath(path, height_m)
    if source is Source.random:
        return random_poses(count, seed, heading_step_deg, extent_m, height_m)
    raise ConfigError(f"queries={source.value} would be the places themselves; give random, path or recorded")


def plan_of_trajectory(sensor: Sensor, source: Source, path: str, height_m: float | None) -> Plan:
    """The poses of a trajectory, in order: a whole recording, a file of poses, or a path that the world knows by name."""
    if source is Source.recorded:
        return sensor.plan(RecordedPoses())
    if Path(path).suffix:
        trajectory = read_trajectory(Path(path))
        plausibility.warn(path, trajectory)
        return sensor.plan(PathPoses(trajectory.T_world_camera))
    return sensor.plan(NamedPath(path, height_m))


def changed(component: C, where: str, settings: Mapping[str, Any], kind: str = "sensor") -> C:
    """A component with some of its settings changed; ConfigError, naming `where` they are set, for those it does not have."""
    known = [f.name for f in fields(component)]  # type: ignore[arg-type]
    for name in settings:
        if name not in known:
            raise ConfigError(
                f"{where} changes '{name}', which is no setting of the {kind}; there is"
                f" {', '.join(known)}{did_you_mean(name, known)}"
            )
    try:
        return replace(component, **settings)  # type: ignore[type-var]
    except TypeError as error:
        raise ConfigError(f"{where}={dict(settings)} cannot be set ({error}); correct it") from error
