"""Which run folders are runs of a claim: those of its configuration, whatever they were begun for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from omnilab.errors import OmnilabError
from omnilab.runner.compare.configurations import BESIDE, SectionReader, Settings
from omnilab.runner.compare.gathering import ComparedRun, LeftOut, gather
from omnilab.runner.config import resolved_yaml
from omnilab.runner.fidelity.claims import ClaimRun
from omnilab.runner.overrides.composition import check_build, compose_job
from omnilab.runner.registry import Registry

Key = frozenset[tuple[str, str]]  # all settings but the seed and those that change no result


class RunMatcher:
    """Finds the finished runs of each `ClaimRun`: its recipe, composed as of now, has exactly their settings."""

    def __init__(self, wanted: Iterable[ClaimRun], registry: Registry) -> None:
        sections = SectionReader()
        self.problems: dict[str, str] = {}  # by name, of runs whose recipe cannot be composed
        self._names: dict[Key, list[str]] = {}
        for run in wanted:
            try:
                config, _ = compose_job(run.words, registry)
                text = resolved_yaml(check_build(config, registry))
            except OmnilabError as error:
                self.problems[run.name] = str(error)
                continue
            self._names.setdefault(_key(sections.read(text)), []).append(run.name)

    def found(self, folders: Iterable[Path]) -> tuple[dict[str, list[ComparedRun]], list[LeftOut], int]:
        """Finished runs by the name of the `ClaimRun`, one a seed, in the order of seeds; runs that cannot be read or did
        not end; and how many are of no claim. DataError if a folder holds no run."""
        runs, left_out = gather(folders)
        found: dict[str, dict[str, ComparedRun]] = {}
        others = 0
        for run in runs:  # oldest first: the newest of a seed counts
            names = self._names.get(_key(run.configuration.sections), [])
            others += not names
            for name in names:
                found.setdefault(name, {})[run.seed] = run
        return {name: _by_seed(by_seed) for name, by_seed in found.items()}, left_out, others


def _by_seed(runs: Mapping[str, ComparedRun]) -> list[ComparedRun]:
    return [runs[seed] for seed in sorted(runs, key=lambda seed: (len(seed), seed))]


def _key(sections: Mapping[str, Settings]) -> Key:
    return frozenset(item for name, settings in sections.items() if name not in BESIDE for item in settings.items())


def seeds_of(runs: Sequence[ComparedRun]) -> set[str]:
    return {run.seed for run in runs}
