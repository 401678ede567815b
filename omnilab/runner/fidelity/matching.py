"""Which run folders are runs of a claim: those of its configuration, whatever they were begun for."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

from omnilab.errors import DataError, OmnilabError
from omnilab.runner.compare.configurations import Configuration, SectionReader
from omnilab.runner.compare.gathering import ComparedRun, LeftOut, gather
from omnilab.runner.config import Run, components_of, named_components, resolved_yaml
from omnilab.runner.fidelity.claims import ClaimRun
from omnilab.runner.fidelity.measured import MeasuredRun, MeasuredValue, RunSettings
from omnilab.runner.fidelity.quantities import Quantity
from omnilab.runner.overrides.composition import check_build, compose_job
from omnilab.runner.registry import Registry
from omnilab.runner.run_folder import load_run

FoundRuns = dict[str, list[MeasuredRun]]  # by the name of the `ClaimRun`, one a seed, in the order of seeds
KeptRuns = Mapping[str, Sequence[MeasuredRun]]  # the same of a file, which may be of other configurations


@dataclass(frozen=True)
class RunPattern:
    """What a `ClaimRun` is composed of as of now."""

    wanted: RunSettings
    defaults: frozenset[str]  # settings of components that are at their defaults

    @classmethod
    def of(cls, run: Run, registry: Registry, reader: SectionReader) -> RunPattern:
        sections = reader.read(resolved_yaml(run))
        wanted = RunSettings.of(Configuration(sections, named_components(run, registry)))
        defaults = (path for slot, _, value in components_of(vars(run)) for path in _defaults(slot, value))
        return cls(wanted, frozenset(defaults))

    def misfit(self, made: RunSettings) -> str:
        """In what a run differs, the first of it; "" if in nothing. Settings that components did not have yet are at
        their defaults."""
        for now, then in ((self.wanted.components, made.components), (self.wanted.settings, made.settings)):
            for path in dict.fromkeys((*then, *now)):
                if path in then and now.get(path) == then[path]:
                    continue
                if path in then or path not in self.defaults:
                    return f"{path} was {then.get(path, 'not there')}, and is {now.get(path, 'not there')} now"
        return ""


class RunMatcher:
    """Finds the finished runs of each `ClaimRun`: its recipe, composed as of now, has exactly their settings.

    Of each run it reads the `quantities` of its name.
    """

    def __init__(
        self, wanted: Iterable[ClaimRun], quantities: Mapping[str, Sequence[Quantity]], registry: Registry
    ) -> None:
        reader, self._quantities = SectionReader(), quantities
        self.problems: dict[str, str] = {}  # by name, of runs whose recipe cannot be composed
        self._patterns: dict[str, RunPattern] = {}
        for run in wanted:
            try:
                config, _ = compose_job(run.words, registry)
                self._patterns[run.name] = RunPattern.of(check_build(config, registry), registry, reader)
            except OmnilabError as error:
                self.problems[run.name] = str(error)

    def found(self, folders: Iterable[Path], kept: KeptRuns) -> tuple[FoundRuns, list[LeftOut], int]:
        """The newest finished run of each seed, by the name of the `ClaimRun`; runs that cannot be read, did not end, or
        were kept of another configuration; and how many folders are of no claim. DataError if a folder holds no run."""
        runs, left_out = gather(folders)
        fitting = {name: self._kept(name, kept.get(name, ()), left_out) for name in self._patterns}
        others = 0
        for run in runs:
            made = RunSettings.of(run.configuration)
            names = [name for name, pattern in self._patterns.items() if not pattern.misfit(made)]
            others += not names
            for name in names:
                fitting[name].append(measured(run, made, self._quantities.get(name, ())))
        return {name: _newest(found) for name, found in fitting.items() if found}, left_out, others

    def _kept(self, name: str, kept: Iterable[MeasuredRun], left_out: list[LeftOut]) -> list[MeasuredRun]:
        """Those of the configuration that the recipe has now; the others are said."""
        misfits = [(run, self._patterns[name].misfit(run.configuration)) for run in kept]
        left_out += [
            LeftOut(f"{name}, seed {run.seed}", "kept", f"of {run.folder}: {why}") for run, why in misfits if why
        ]
        return [run for run, why in misfits if not why]


def measured(run: ComparedRun, made: RunSettings, quantities: Iterable[Quantity]) -> MeasuredRun:
    """What claims need of a run folder."""
    loaded, values, problems = load_run(run.folder), dict[str, MeasuredValue](), dict[str, str]()
    for quantity in quantities:
        try:
            values[quantity.text] = quantity.measured(run)
        except DataError as error:
            problems[quantity.text] = str(error)
    manifest, progress = loaded.manifest, loaded.progress
    return MeasuredRun(
        seed=run.seed,
        configuration=made,
        folder=f"{run.folder.parent.name}/{run.folder.name}",
        version=str(manifest.get("components", {}).get("study", {}).get("version", "")),
        commit=str(manifest.get("commit") or ""),
        ended=str(loaded.status.get("time", "")),
        run_s=progress.run_s if progress else None,
        values=values,
        problems=problems,
    )


def _newest(runs: Iterable[MeasuredRun]) -> list[MeasuredRun]:
    """One of each seed, in the order of seeds."""
    by_seed = {run.seed: run for run in sorted(runs, key=lambda run: run.age)}
    return [by_seed[seed] for seed in sorted(by_seed, key=lambda seed: (len(seed), seed))]


def _defaults(path: str, component: Any) -> Iterator[str]:
    """The settings of a component, or of a group of its settings, that are at their defaults."""
    for each in fields(component) if is_dataclass(component) else ():
        value = getattr(component, each.name)
        default = each.default if each.default_factory is MISSING else each.default_factory()
        if is_dataclass(value):
            yield from _defaults(f"{path}.{each.name}", value)
        elif value == default:
            yield f"{path}.{each.name}"
