"""The runs that are compared: what is read of each, and why others are left out."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omnilab.errors import DataError
from omnilab.runner.compare.configurations import Configuration, SectionReader
from omnilab.runner.run_folder import DONE, UNREADABLE, LoadedRun, find_runs, load_run

ATTEMPTS = "attempts"  # of a sweep: the folders of earlier attempts at its jobs


@dataclass(frozen=True)
class ComparedRun:
    """A finished run, as far as it is compared."""

    name: str
    folder: Path
    study: str
    seed: str
    configuration: Configuration
    metrics: Mapping[str, float]
    units: Mapping[str, str]
    intervals: Mapping[str, tuple[float, float]]  # 95 %, of metrics that have one


@dataclass(frozen=True)
class LeftOut:
    """A run that is not compared, and why."""

    name: str
    state: str
    why: str


def gather(folders: Iterable[Path]) -> tuple[list[ComparedRun], list[LeftOut]]:
    """The finished runs in folders of runs and sweeps, each once, and the others.

    DataError if a folder is not there, or holds no run.
    """
    found = {run.folder: run for folder in folders for run in _runs_of(folder)}
    names = _names(list(found))
    sections, runs, left_out = SectionReader(), list[ComparedRun](), list[LeftOut]()
    for folder, name in names.items():
        run = found.pop(folder)  # and with it what is not kept of what was read
        try:
            if run.state == DONE:
                runs.append(_compared(run, name, sections))
            else:
                left_out.append(LeftOut(name, run.state, str(run.status.get("error", ""))))
        except DataError as error:
            left_out.append(LeftOut(name, UNREADABLE, str(error)))
    return runs, left_out


def _runs_of(folder: Path) -> list[LoadedRun]:
    """The run in a folder, or all below it: those of a sweep."""
    if (folder / "status.json").is_file() or not folder.is_dir():
        return [load_run(folder)]
    path = folder.resolve()
    runs = [run for run in find_runs(path) if ATTEMPTS not in run.folder.relative_to(path).parts]
    if not runs:
        raise DataError(f"{folder} holds no run, and no sweep; `omnilab runs` lists the runs there are")
    return sorted(runs, key=_by_job)


def _by_job(run: LoadedRun) -> tuple[str, int, str]:
    """In the order of the numbers of a sweep's jobs."""
    name = run.folder.name
    return str(run.folder.parent), int(name) if name.isdecimal() and name.isascii() else -1, name


def _names(folders: Sequence[Path]) -> dict[Path, str]:
    """Short names of runs: their folders, without what all of them begin with."""
    common = os.path.commonpath([folder.parent for folder in folders]) if folders else ""
    return {folder: str(folder).removeprefix(common).lstrip("/") for folder in folders}


def _compared(run: LoadedRun, name: str, sections: SectionReader) -> ComparedRun:
    """What is compared of a finished run; DataError if a file of it is damaged."""
    manifest = run.manifest
    components = _mapping(run, manifest, "components")
    if not all(isinstance(component, dict) for component in components.values()):
        raise run.unreadable("manifest.json", "its components should be mappings")
    files = _mapping(run, manifest, "files")
    configuration = Configuration(run.parsed("config.yaml", sections.read), components, files, manifest["overrides"])
    study = str(components.get("study", {}).get("name") or manifest["experiment"])
    seed = configuration.sections.get("seed", {}).get("seed", "")
    return ComparedRun(name, run.folder, study, seed, configuration, run.metrics, run.units, run.intervals)


def _mapping(run: LoadedRun, manifest: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """A part of a manifest that runs of before may not have."""
    found = manifest.get(key, {})
    if not isinstance(found, dict):
        raise run.unreadable("manifest.json", f"its {key} should be a mapping")
    return found
