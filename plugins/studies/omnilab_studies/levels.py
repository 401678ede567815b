"""Disturbances at several strengths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, NamedTuple

from omnilab.api import Disturbance
from omnilab.errors import ConfigError, did_you_mean


class Level(NamedTuple):
    """A disturbance at one strength; none at all is the level "clear"."""

    disturbance: str
    setting: str = ""
    value: float | str = ""
    applied: Mapping[str, Disturbance] = {}

    @property
    def title(self) -> str:
        return f"{self.disturbance} {self.value:g}" if isinstance(self.value, float | int) else self.disturbance


def are_numbers(values: Sequence[Any]) -> bool:
    """Whether there are some, whole or not: whole ones are no floats to OmegaConf, so the field cannot say it."""
    return len(values) > 0 and all(isinstance(value, int | float) for value in values)


def at_strength(disturbance: Any, name: str, setting: str, value: float) -> Disturbance:
    """A disturbance with one setting changed."""
    known = [f.name for f in fields(disturbance)]
    if setting not in known:
        raise ConfigError(
            f"study.levels.{name} varies '{setting}', which is no setting of {name}; there is {', '.join(known)}"
            f"{did_you_mean(setting, known)}"
        )
    whole = isinstance(getattr(disturbance, setting), int)
    changed: Disturbance = replace(disturbance, **{setting: int(value) if whole else float(value)})
    return changed
