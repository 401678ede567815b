"""A finished run of a claim, as far as claims need it: read from its folder, or kept from one that may be gone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime

from omnilab.errors import DataError
from omnilab.runner.compare.configurations import BESIDE, Configuration, Settings

NEVER = datetime.min.replace(tzinfo=UTC)  # of a run that does not say when it ended


@dataclass(frozen=True)
class MeasuredValue:
    """A number of a run, with its interval of 95 % and its unit where it has these. What is not finite is NaN, or none."""

    value: float
    low: float | None = None
    high: float | None = None
    unit: str = ""

    def __post_init__(self) -> None:
        if not math.isfinite(self.value):
            object.__setattr__(self, "value", math.nan)
        if not all(bound is not None and math.isfinite(bound) for bound in (self.low, self.high)):
            object.__setattr__(self, "low", None)
            object.__setattr__(self, "high", None)


@dataclass(frozen=True)
class RunSettings:
    """What a run was composed of, but for the seed and what changes no result."""

    components: Mapping[str, str]  # registered names by slot
    settings: Settings

    @classmethod
    def of(cls, configuration: Configuration) -> RunSettings:
        names = {slot: str(named.get("name")) for slot, named in configuration.components.items() if counts(slot)}
        return cls(names, counting(configuration.sections))


@dataclass(frozen=True)
class MeasuredRun:
    """A run with the values that claims need of it, by the text of their quantities; and why it lacks some."""

    seed: str
    configuration: RunSettings
    folder: str  # its name, with that of the folder above
    version: str = ""  # of omnilab
    commit: str = ""
    ended: str = ""  # ISO 8601; "": not known
    run_s: float | None = None  # how long it took
    values: Mapping[str, MeasuredValue] = field(default_factory=dict)
    problems: Mapping[str, str] = field(default_factory=dict)
    kept: bool = False  # read from a file of kept measurements

    def value(self, quantity: str) -> MeasuredValue:
        """DataError if it has none."""
        if quantity not in self.values:
            kept = f"nothing was kept of {quantity} of {self.folder}; run it again"
            raise DataError(self.problems.get(quantity, kept))
        return self.values[quantity]

    @property
    def age(self) -> tuple[datetime, bool, str]:
        """By which runs are sorted, oldest first; of the same run its folder is the younger."""
        return ended_at(self.ended), not self.kept, self.folder

    @property
    def made_by(self) -> str:
        """Version and commit of the omnilab that made it."""
        changed = "+changes" if self.commit.endswith("+changes") else ""
        return " ".join(filter(None, [self.version, f"`{self.commit[:7]}{changed}`" if self.commit else ""]))


def ended_at(text: str) -> datetime:
    """The time of an ISO 8601 text with a time zone; `NEVER` of any other."""
    try:
        found = datetime.fromisoformat(text)
    except ValueError:
        return NEVER
    return found if found.tzinfo else NEVER


def counts(path: str) -> bool:
    """Whether results depend on a slot."""
    return path.partition(".")[0] not in BESIDE


def counting(sections: Mapping[str, Settings]) -> Settings:
    """The settings that results depend on, the seed apart."""
    return {path: value for name, settings in sections.items() if counts(name) for path, value in settings.items()}
