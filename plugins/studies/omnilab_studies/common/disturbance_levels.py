"""Levels of disturbances: one setting of each, at several values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, NamedTuple

from omnilab.api import Disturbance, Recorder, Text
from omnilab.errors import ConfigError, did_you_mean


class Level(NamedTuple):
    """A disturbance with one setting at one value; the level "clear" has none."""

    disturbance: str
    setting: str = ""
    value: float | str = ""
    applied: Mapping[str, Disturbance] = {}

    @property
    def title(self) -> str:
        """The disturbance and its value, for figures and logs."""
        return f"{self.disturbance} {self.value:g}" if isinstance(self.value, float | int) else self.disturbance


def are_numbers(values: Sequence[Any]) -> bool:
    """Whether these are one or more numbers: OmegaConf takes no integers for floats, so the field's type cannot check it."""
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


def check_levels(levels: Mapping[str, Mapping[str, Sequence[Any]]]) -> None:
    """ConfigError unless these are one setting with numbers for each disturbance."""
    for name, settings in levels.items():
        if len(settings) != 1 or not all(are_numbers(values) for values in settings.values()):
            raise ConfigError(
                f"study.levels.{name}={settings} is not one setting with numbers; give {{SETTING: [NUMBER, ...]}}"
            )


def levels_of(
    levels: Mapping[str, Mapping[str, Sequence[Any]]], disturbances: Mapping[str, Disturbance], record: Recorder,
    corrections: Sequence[str] = (),
) -> list[Level]:  # fmt: skip
    """Clear, and every level of every disturbance; one without `levels` has its own settings alone.

    Those that are named as `corrections` are no levels: they are applied after each, and after none too.
    """
    if unknown := [name for name in corrections if name not in disturbances]:
        raise ConfigError(
            f"study.corrections names '{unknown[0]}', which is no disturbance of the run; there is"
            f" {', '.join(disturbances)}{did_you_mean(unknown[0], list(disturbances))}"
        )
    after = {name: disturbances[name] for name in corrections}
    disturbances = {name: own for name, own in disturbances.items() if name not in after}
    for name in sorted(levels.keys() - disturbances.keys()):
        record.log("log", Text(f"study.levels.{name} is not used: the run has no disturbance '{name}'"))
    found = [Level("clear", applied=after)]
    for name, disturbance in disturbances.items():
        if name not in levels:
            found.append(Level(name, value="as set", applied={name: disturbance, **after}))
            continue
        ((setting, values),) = levels[name].items()
        found += [Level(name, setting, v, {name: at_strength(disturbance, name, setting, v), **after}) for v in values]
    return found
