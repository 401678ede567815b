"""Records of runs, from their folders."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import Any

from omnilab.client import RunRecord, StageProgress
from omnilab.errors import DataError
from omnilab.runner.compare.configurations import SectionReader
from omnilab.runner.run_folder.names import CONFIG, DONE, FAILED, INTERRUPTED, KILLED, RUNNING, SUMMARY, UNREADABLE
from omnilab.runner.run_folder.progress import RunProgress
from omnilab.runner.run_folder.reading import LARGEST_FILE, LoadedRun
from omnilab.runner.sweeps.job_log import JOBS
from omnilab.runner.sweeps.plan_file import PLAN
from omnilab_serve.security.links import outward_link, sentence

OF_SWEEP = {JOBS, PLAN, SUMMARY}  # a folder with one of these is a sweep's
STAMP, STAMP_LENGTH = "%Y-%m-%d_%H-%M-%S", 19  # how the name of a run's folder begins


def run_record(run: LoadedRun, logs: Path) -> RunRecord:
    """A run as its folder tells; one that is damaged says why, as its error."""
    root = logs.resolve()
    return record_at(run.folder.resolve().relative_to(root).as_posix(), root, SectionReader())


def record_at(path: str, root: Path, sections: SectionReader) -> RunRecord:
    """The run of a path below the logs, which are `root`, links resolved; `sections` read many configurations at once."""
    run = LoadedRun(root / path)
    sweep = _sweep_of(path, root)
    try:
        _check_links(path, root)
        _check_size(run)
        state, manifest, status, progress = run.state, run.manifest, run.status, run.progress
        metrics = {name: value if math.isfinite(value) else None for name, value in run.metrics.items()}
        intervals = {name: pair for name, pair in run.intervals.items() if all(map(math.isfinite, pair))}
    except (DataError, OSError) as error:
        return RunRecord(
            path, UNREADABLE, started=time_in_name(run.folder.name), error=encodable(str(error)), sweep=sweep
        )
    began = _instant(progress.began if progress else None) or time_in_name(run.folder.name)
    started = began or _instant(status.get("time"))
    return RunRecord(
        path,
        encodable(state),
        experiment=encodable(manifest["experiment"]),
        overrides=[encodable(word) for word in manifest["overrides"] if not word.startswith("experiment=")],
        components=_components(manifest.get("components")),
        settings=encodable(_settings(run, sections)),
        metrics=metrics,
        intervals=intervals,
        units=run.units,
        started=started,
        seconds=_seconds(state, started, status, progress),
        host=_text(manifest.get("host"), "name"),
        error=_text(status, "error"),
        sweep=sweep,
        progress=stage_progress(progress) if state == RUNNING else None,
    )


def encodable(value: Any) -> Any:
    """The same, with question marks for halves of characters: JSON and YAML can say them, and no page or answer can be made of them."""
    match value:
        case str():
            return value if value.isascii() else value.encode("utf-8", "replace").decode()
        case dict():
            return {encodable(name): encodable(member) for name, member in value.items()}
        case list() | tuple():
            return list(map(encodable, value))
        case _:
            return value


def _check_links(path: str, root: Path) -> None:
    """DataError for a run whose files lie elsewhere: who may read the logs may not read those."""
    try:
        link = outward_link(root / path, root)
    except OSError:  # reading says why
        return
    if link:
        raise DataError(sentence(path, link))


def _check_size(run: LoadedRun) -> None:
    """DataError for metrics that would fill the memory: there are some dozens of them."""
    with suppress(FileNotFoundError):
        if (size := (run.folder / "metrics.csv").stat().st_size) > LARGEST_FILE:
            raise run.unreadable("metrics.csv", f"it has {size} bytes, more than {LARGEST_FILE}")


def stage_progress(progress: RunProgress | None) -> StageProgress | None:
    """How far a run is, as the API has it."""
    return StageProgress(progress.fraction or 0.0, progress.words, progress.left_s) if progress else None


def _text(content: object, name: str) -> str | None:
    value = content.get(name) if isinstance(content, dict) else None
    return encodable(value) if isinstance(value, str) else None


def _components(content: object) -> dict[str, str]:
    slots = content if isinstance(content, dict) else {}
    return {encodable(slot): name for slot, found in slots.items() if (name := _text(found, "name"))}


def _settings(run: LoadedRun, sections: SectionReader) -> dict[str, Any]:
    """All settings by their full names; none where the configuration is missing or damaged, which the run's page says."""
    try:
        found: dict[str, dict[str, str]] = run.parsed(CONFIG, sections.read)
    except DataError:
        return {}
    return {name: _value(text) for section in found.values() for name, text in section.items()}


@lru_cache(maxsize=10_000)
def _value(text: str) -> Any:
    """A setting's value, of the text that an override would have; numbers that JSON does not know stay texts."""
    try:
        return json.loads(text, parse_float=_finite, parse_constant=_finite)
    except (ValueError, RecursionError):
        return text


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def _sweep_of(path: str, root: Path) -> str | None:
    """The path of the nearest folder above a run that is a sweep's."""
    parts = path.split("/")[:-1]
    for depth in range(len(parts), 0, -1):
        folder = root.joinpath(*parts[:depth])
        if any((folder / name).is_file() for name in OF_SWEEP):
            return "/".join(parts[:depth])
    return None


def _seconds(state: str, started: str | None, status: Mapping[str, Any], progress: RunProgress | None) -> float | None:
    """How long a run took, or has taken by what it wrote last; of one that was killed nobody wrote it down."""
    if state == KILLED:
        return None
    known = [progress.run_s] if progress else []
    if state in (DONE, FAILED, INTERRUPTED) and started and (ended := _instant(status.get("time"))):
        known.append((datetime.fromisoformat(ended) - datetime.fromisoformat(started)).total_seconds())
    return max(known) if known and max(known) >= 0 else None


def _instant(text: object) -> str | None:
    """A time of ISO 8601 in UTC, so that times sort as their texts do; None for what is none."""
    try:
        return datetime.fromisoformat(str(text)).astimezone(UTC).isoformat()
    except (ValueError, OverflowError):
        return None


def time_in_name(name: str) -> str | None:
    """When a run began, by the name of its folder and the time zone of here."""
    try:
        return datetime.strptime(name[:STAMP_LENGTH], STAMP).astimezone().astimezone(UTC).isoformat()
    except (ValueError, OverflowError):
        return None
