"""Which run folders are runs of a claim: those of its configuration, whatever they were begun for."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

from omnilab.errors import OmnilabError
from omnilab.runner.compare.configurations import BESIDE, Configuration, SectionReader, Settings
from omnilab.runner.compare.gathering import ComparedRun, LeftOut, gather
from omnilab.runner.config import Run, components_of, named_components, resolved_yaml
from omnilab.runner.fidelity.claims import ClaimRun
from omnilab.runner.overrides.composition import check_build, compose_job
from omnilab.runner.registry import Registry


@dataclass(frozen=True)
class RunPattern:
    """What a `ClaimRun` is composed of, but for the seed and what changes no result."""

    components: Mapping[str, str]  # registered names by slot
    settings: Settings
    defaults: frozenset[str]  # settings of components that are at their defaults

    @classmethod
    def of(cls, run: Run, registry: Registry, reader: SectionReader) -> RunPattern:
        names = {slot: named["name"] for slot, named in named_components(run, registry).items()}
        settings = _counting(reader.read(resolved_yaml(run)))
        defaults = (path for slot, _, value in components_of(vars(run)) for path in _defaults(slot, value))
        return cls(_beside_none(names), settings, frozenset(defaults))

    def fits(self, configuration: Configuration) -> bool:
        """Whether a run is of this configuration. Settings that components did not have yet are at their defaults."""
        names = {slot: str(named.get("name")) for slot, named in configuration.components.items()}
        settings = _counting(configuration.sections)
        new = self.settings.keys() - settings.keys()
        return (
            _beside_none(names) == self.components
            and new <= self.defaults
            and settings == {path: value for path, value in self.settings.items() if path not in new}
        )


class RunMatcher:
    """Finds the finished runs of each `ClaimRun`: its recipe, composed as of now, has exactly their settings."""

    def __init__(self, wanted: Iterable[ClaimRun], registry: Registry) -> None:
        reader = SectionReader()
        self.problems: dict[str, str] = {}  # by name, of runs whose recipe cannot be composed
        self._patterns: dict[str, RunPattern] = {}
        for run in wanted:
            try:
                config, _ = compose_job(run.words, registry)
                self._patterns[run.name] = RunPattern.of(check_build(config, registry), registry, reader)
            except OmnilabError as error:
                self.problems[run.name] = str(error)

    def found(self, folders: Iterable[Path]) -> tuple[dict[str, list[ComparedRun]], list[LeftOut], int]:
        """Finished runs by the name of the `ClaimRun`, one a seed, in the order of seeds; runs that cannot be read or did
        not end; and how many are of no claim. DataError if a folder holds no run."""
        runs, left_out = gather(folders)
        found: dict[str, dict[str, ComparedRun]] = {}
        others = 0
        for run in runs:  # oldest first: the newest of a seed counts
            names = [name for name, pattern in self._patterns.items() if pattern.fits(run.configuration)]
            others += not names
            for name in names:
                found.setdefault(name, {})[run.seed] = run
        return {name: _by_seed(by_seed) for name, by_seed in found.items()}, left_out, others


def _by_seed(runs: Mapping[str, ComparedRun]) -> list[ComparedRun]:
    return [runs[seed] for seed in sorted(runs, key=lambda seed: (len(seed), seed))]


def _counting(sections: Mapping[str, Settings]) -> Settings:
    """The settings that results depend on, the seed apart."""
    return {
        path: value for name, settings in sections.items() if name not in BESIDE for path, value in settings.items()
    }


def _beside_none(names: Mapping[str, str]) -> dict[str, str]:
    """Components without those that change no result."""
    return {slot: name for slot, name in names.items() if slot.partition(".")[0] not in BESIDE}


def _defaults(path: str, component: Any) -> Iterator[str]:
    """The settings of a component, or of a group of its settings, that are at their defaults."""
    for each in fields(component) if is_dataclass(component) else ():
        value = getattr(component, each.name)
        default = each.default if each.default_factory is MISSING else each.default_factory()
        if is_dataclass(value):
            yield from _defaults(f"{path}.{each.name}", value)
        elif value == default:
            yield f"{path}.{each.name}"


def seeds_of(runs: Sequence[ComparedRun]) -> set[str]:
    return {run.seed for run in runs}
