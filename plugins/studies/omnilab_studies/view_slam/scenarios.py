"""Scenarios of simulated drives, as YAML files: a path, walls, and the noise of odometry."""

from __future__ import annotations

import os
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Floats
from omnilab.errors import DataError, did_you_mean
from omnilab.file_kinds import content_of

MAX_BYTES = 100_000
DEEPEST = 16  # brackets within brackets
MAX_STEPS = 20_000  # of one lap
ROUNDINGS = 3  # each cuts every corner
KEYS = ("path_m", "walls_m", "step_m", "odometry")
NOISES = ("along_m", "across_m", "heading_deg", "turn_deg")


class Noise(NamedTuple):
    """Noise of odometry: standard deviations over a metre, along, across and in heading, and over a radian, in heading.

    They grow with the root of the length and the rotation.
    """

    along_m: float
    across_m: float
    heading_deg: float
    turn_deg: float

    def covariances(self, motions: Floats) -> Floats:
        """Covariances (M, 3, 3) of motions (M, 3), each in the frame that it starts from."""
        length, rotation = np.hypot(motions[:, 0], motions[:, 1]), np.abs(motions[:, 2])
        heading = np.radians(self.heading_deg) ** 2 * length + np.radians(self.turn_deg) ** 2 * rotation
        variances = np.column_stack([self.along_m**2 * length, self.across_m**2 * length, heading])
        return np.asarray(variances[:, :, None] * np.eye(3))


@dataclass(frozen=True)
class Scenario:
    """A closed path, walls, and the noise of odometry."""

    name: str
    lap: Floats  # (L, 3) x, y and heading, a step apart; the last is a step before the first
    walls_m: Floats  # (W, 2, 2) their ends
    step_m: float
    noise: Noise


def shipped() -> dict[str, Path]:
    """The scenarios that come with the studies, by name."""
    found = [Path(str(file)) for file in files("omnilab_studies").joinpath("scenarios").iterdir()]
    return {file.stem: file for file in sorted(found) if file.suffix == ".yaml"}


def scenario(name: str) -> Scenario:
    """A shipped scenario by its name, or that of a YAML file; DataError if it has a mistake."""
    file = shipped().get(name, Path(os.path.expanduser(name)))  # noqa: PTH111  which raises nothing
    try:
        data = content_of(file, MAX_BYTES)
    except OSError as error:
        raise DataError(
            f"the scenario {name} cannot be read ({error.strerror}){did_you_mean(name, shipped())}; give one of"
            f" {', '.join(shipped())}, or a YAML file"
        ) from None
    return _scenario(file, _content(file, data))


def _content(file: Path, data: bytes) -> dict[str, Any]:
    import yaml

    try:
        depth = 0
        for event in yaml.parse(data, Loader=yaml.SafeLoader):
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > DEEPEST:
                raise DataError(
                    f"{file} is nested deeper than {DEEPEST} levels; write a scenario, as docs/views.md has it"
                )
            if isinstance(event, yaml.AliasEvent):  # nine of nine of nine ... of them fill any memory
                line = event.start_mark.line + 1 if event.start_mark else "?"
                raise DataError(f"{file}, line {line}: '*{event.anchor}' is an alias; write the value out")
        content = yaml.safe_load(data)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1} cannot be read" if mark else "it cannot be read"
        raise DataError(f"{file} is no YAML ({where}); mend it") from error
    return _mapping(file, "the scenario", content, KEYS)


def _scenario(file: Path, content: dict[str, Any]) -> Scenario:
    corners, walls = _rows(file, content, "path_m", 2), _rows(file, content, "walls_m", 4)
    if len(corners) < 3:
        raise DataError(f"{file}: path_m has {len(corners)} corners; give 3 or more, as [x, y]")
    step_m = _positive(file, "step_m", content["step_m"])
    noises = _mapping(file, "odometry", content["odometry"], NOISES)
    noise = Noise(**{name: _positive(file, f"odometry.{name}", noises[name]) for name in NOISES})
    length = np.linalg.norm(np.diff(corners, axis=0, append=corners[:1]), axis=1).sum()
    if not 8 * step_m <= length <= MAX_STEPS * step_m:
        raise DataError(f"{file}: a path of {length:.4g} m has no 8 to {MAX_STEPS} steps of {step_m} m; change step_m")
    return Scenario(file.stem, lap(corners, step_m), walls.reshape(-1, 2, 2), step_m, noise)


def _mapping(file: Path, what: str, content: Any, keys: tuple[str, ...]) -> dict[str, Any]:
    """Content with these keys and no others."""
    if not isinstance(content, dict):
        raise DataError(f"{file}: {what} is {content!r:.60}; give a mapping of {', '.join(keys)}")
    for key in content:
        if key not in keys:
            raise DataError(f"{file}: {what} has no '{key}'{did_you_mean(str(key), keys)}; give {', '.join(keys)}")
    for key in keys:
        if key not in content:
            raise DataError(f"{file}: {what} lacks '{key}'; give {', '.join(keys)}")
    return content


def _rows(file: Path, content: dict[str, Any], name: str, width: int) -> Floats:
    """A list of rows of so many finite numbers, as (N, width)."""
    try:
        rows = np.array(content[name], float).reshape(-1, width)
    except (TypeError, ValueError, OverflowError):
        rows = np.full((1, width), np.nan)
    if not np.isfinite(rows).all() or len(rows) != len(content[name]):
        raise DataError(f"{file}: {name} is {content[name]!r:.80}; give a list of rows of {width} numbers, in metres")
    return rows


def _positive(file: Path, name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < np.inf:
        raise DataError(f"{file}: {name} is {value!r:.60}; give a number above 0")
    return float(value)


def lap(corners_m: Floats, step_m: float) -> Floats:
    """Poses (L, 3) along a closed path of corners (C, 2), which are cut (Chaikin, 1974), headed along it."""
    line = corners_m
    for _ in range(ROUNDINGS):
        ahead = np.roll(line, -1, axis=0)
        line = np.stack([0.75 * line + 0.25 * ahead, 0.25 * line + 0.75 * ahead], 1).reshape(-1, 2)
    closed = np.concatenate([line, line[:1]])
    along = np.append(0, np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1)))
    at = np.linspace(0, along[-1], round(along[-1] / step_m), endpoint=False)
    position = np.column_stack([np.interp(at, along, axis) for axis in closed.T])
    ahead = np.roll(position, -1, axis=0) - position
    return np.column_stack([position, np.arctan2(ahead[:, 1], ahead[:, 0])])
