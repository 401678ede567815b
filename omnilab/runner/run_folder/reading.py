"""Reading run folders, which may be damaged, or a stranger's."""

from __future__ import annotations

import csv
import io
import json
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Any

from omnilab.atomic_files import is_process
from omnilab.errors import DataError
from omnilab.file_kinds import content_of
from omnilab.runner.run_folder import process
from omnilab.runner.run_folder.lock import REPAIR, RUN, LockState, ago, by_time, lock_state
from omnilab.runner.run_folder.names import CONFIG, KILLED, MANIFEST, METRICS, RUNNING, SILENT, STATUS
from omnilab.runner.run_folder.progress import RunProgress, read_progress

LARGEST_FILE, LARGEST_TABLE = 4 * 2**20, 256 * 2**20  # bytes
DEEPEST = 32  # brackets within brackets
CLOCKS_S = 10.0  # by which the times of a process and of a file may differ


@dataclass(frozen=True)
class LoadedRun:
    """A run folder, read."""

    folder: Path

    @cached_property
    def status(self) -> dict[str, Any]:
        return self._read(STATUS, json.loads, status=str, pid=int)

    @cached_property
    def manifest(self) -> dict[str, Any]:
        content = self._read(MANIFEST, json.loads, experiment=str, overrides=list)
        if not all(isinstance(override, str) for override in content["overrides"]):
            raise self.unreadable(MANIFEST, "overrides should be a list of texts")
        return content

    @cached_property
    def config(self) -> dict[str, Any]:
        """The resolved configuration."""
        return self._read(CONFIG, safe_yaml, study=dict)

    @cached_property
    def metrics(self) -> dict[str, float]:
        """By name. Empty for a run that did not finish."""
        columns, rows = self._metric_table
        name, value = columns["metric"], columns["value"]
        try:
            return {row[name]: float(row[value]) for row in rows}
        except ValueError:  # one without a value, or damaged
            return {row[name]: self._number(row, "value") for row in rows}

    @cached_property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """95 % confidence of the metrics for which it was estimated."""
        columns, rows = self._metric_table
        if "low" not in columns:
            return {}
        if "high" not in columns:
            raise self.unreadable("metrics.csv", "it has a column low, and none that is called high")
        name, low, high = columns["metric"], columns["low"], columns["high"]
        try:
            return {row[name]: (float(row[low]), float(row[high])) for row in rows if row[low]}
        except ValueError:  # damaged
            known = [row for row in rows if row[low]]
            return {row[name]: (self._number(row, "low"), self._number(row, "high")) for row in known}

    @cached_property
    def notes(self) -> dict[str, str]:
        """Why there is no value, of the metrics without one."""
        return {name: note for name, note in self._metric_texts("note").items() if note}

    @cached_property
    def units(self) -> dict[str, str]:
        return self._metric_texts("unit")

    @cached_property
    def _metric_table(self) -> tuple[dict[str, int], list[list[str]]]:
        """The columns of the metrics by name, and their rows."""
        header, *rows = self._table("metrics") or [METRICS]
        columns = {name: i for i, name in enumerate(header)}
        if not columns.keys() >= {"metric", "value", "unit"}:
            raise self.unreadable("metrics.csv", "its columns should be metric, value, unit")
        return columns, rows

    def _metric_texts(self, column: str) -> dict[str, str]:
        """One column of the metrics, by their names; none if there is no such column."""
        columns, rows = self._metric_table
        name, at = columns["metric"], columns.get(column)
        return {} if at is None else {row[name]: row[at] for row in rows}

    def _number(self, row: Sequence[str], column: str) -> float:
        columns, _ = self._metric_table
        try:
            text = row[columns[column]]
            return math.nan if not text and "note" in columns and row[columns["note"]] else float(text)
        except (KeyError, ValueError) as error:
            raise self.unreadable("metrics.csv", f"{column} of {row[columns['metric']]} is no number") from error

    def table(self, name: str) -> list[dict[str, str]]:
        """The rows of one CSV file of the run; none if it was not written. DataError if it is damaged."""
        header, *rows = self._table(name) or [[]]
        return [dict(zip(header, row, strict=True)) for row in rows]

    def _table(self, name: str) -> list[list[str]]:
        """The first line and the rows of one CSV file of the run; nothing if it was not written."""
        try:
            rows: list[list[str]] = self.parsed(f"{name}.csv", _csv_rows)
        except DataError as error:
            if isinstance(error.__cause__, FileNotFoundError):
                return []
            raise
        return rows

    @property
    def alive(self) -> bool:
        """Whether the run goes on, or may: nothing of it is to be touched."""
        return self.state in (RUNNING, SILENT)

    @property
    def state(self) -> str:
        """The status; of one that says "running", whether its process is there, was killed, or cannot be told (silent)."""
        if self.status["status"] != RUNNING:
            return str(self.status["status"])
        found = self.lock
        if found.state == RUNNING and found.purpose == RUN:
            return RUNNING
        self.__dict__.pop("status", None)  # it may have ended while we looked
        status = str(self.status["status"])
        if status == RUNNING:
            return KILLED if found.purpose == REPAIR else found.state
        return status

    @property
    def progress(self) -> RunProgress | None:
        """How far the run has come, or had when it ended; None if that is not known. Read anew each time."""
        return read_progress(self.folder)

    @property
    def lock(self) -> LockState:
        """What is known of the process that writes, or wrote, the run."""
        return lock_state(self.folder) or self._by_pid()

    def _by_pid(self) -> LockState:
        """Of a run of before, which has no lock: by its process, and by what it wrote last."""
        host, last_s = self._host(), max(map(_changed_s, (self.folder / STATUS, *self.folder.glob("run.*"))))
        elsewhere = host not in (None, process.host())
        state = by_time(last_s) if elsewhere or self._may_be(self.status["pid"]) else KILLED
        where = f", on host {host}" if host else ""
        return LockState(state, RUN, f"(process {self.status['pid']}){where}, last change {ago(last_s)}")

    def _host(self) -> str | None:
        """Where the run was made; None if it does not say."""
        try:
            host = self.manifest.get("host")
        except DataError:
            return None
        name = host.get("name") if isinstance(host, dict) else None
        return name if isinstance(name, str) else None

    def _may_be(self, pid: int) -> bool:
        """Whether the process of this number may be the run's: no other program, and no younger than the run."""
        found = process.process(pid)
        if found is None or found.ended:
            return found is None and is_process(pid)
        if b"omnilab" not in found.command and b"python" not in found.command:
            return False
        try:
            opened_s = datetime.fromisoformat(str(self.status.get("time"))).timestamp()
        except ValueError:
            return True
        return process.started_s(found) < opened_s + CLOCKS_S

    def _read(self, name: str, parse: Callable[[str], Any], **types: type) -> dict[str, Any]:
        """A file of the run that must be a mapping with these keys and types of content; DataError if it is not."""
        content = self.parsed(name, parse)
        if not isinstance(content, dict) or not content.keys() >= types.keys():
            raise self.unreadable(name, f"it should hold {', '.join(types)}")
        for key, wanted in types.items():
            if type(content[key]) is not wanted:
                raise self.unreadable(name, f"its {key} is {content[key]!r:.60}")
        return content

    def parsed(self, name: str, parse: Callable[[str], Any]) -> Any:
        """What `parse` makes of the text of one file; DataError if it raises, or there is no such file."""
        try:
            largest = LARGEST_TABLE if name.endswith(".csv") else LARGEST_FILE
            return parse(content_of(f"{self.folder}/{name}", largest).decode())
        except Exception as error:
            raise self.unreadable(name, _why(error)) from error

    def unreadable(self, name: str, why: object) -> DataError:
        """The error about a damaged file."""
        reason = " ".join(str(why).split())
        return DataError(
            f"{self.folder / name} cannot be read ({reason}); remove the folder, or run the experiment again"
        )


def _changed_s(file: Path) -> float:
    """When a file was changed, in seconds since 1970; 0 if it is gone."""
    try:
        return file.lstat().st_mtime
    except OSError:
        return 0.0


def _csv_rows(text: str) -> list[list[str]]:
    """Header and rows of a CSV file; ValueError if it is torn."""
    if not text.endswith("\n"):
        raise ValueError("it ends within a line")
    rows = list(csv.reader(io.StringIO(text, newline=""), strict=True))
    if len(set(map(len, rows))) != 1:
        raise ValueError("a row has more or fewer values than the first line has names")
    return rows


def safe_yaml(text: str) -> Any:
    """The content of a YAML file; ValueError if it has aliases or deep brackets: none of ours has, and they fill any memory."""
    import yaml

    loader, depth = getattr(yaml, "CSafeLoader", yaml.SafeLoader), 0
    for event in yaml.parse(text, Loader=loader):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST or isinstance(event, yaml.AliasEvent):
            raise ValueError("it has an alias, or is nested too deeply")
    return yaml.load(text, loader)


def _why(error: Exception) -> str:
    """What a file of a run lacks, in our words: what parsers say speaks of their own inside."""
    match error:
        case OSError(strerror=str(reason)):
            return reason
        case UnicodeDecodeError():
            return "it is no text in UTF-8"
        case json.JSONDecodeError():
            return f"line {error.lineno} is no JSON"
        case csv.Error():
            return "it is no CSV"
        case ValueError() | OSError():
            return str(error)
        case _:
            mark = getattr(error, "problem_mark", None)
            return f"line {mark.line + 1} is no YAML" if mark else "it is damaged"


def load_run(folder: str | Path) -> LoadedRun:
    """The run in a folder; DataError if there is none."""
    path = Path(folder)
    if not (path / STATUS).is_file():
        jobs = f", but the jobs of a sweep: give one, such as {path / '0'}" if (path / "0" / STATUS).is_file() else ""
        raise DataError(f"{path} holds no run (no status.json){jobs}; `omnilab runs` lists the runs there are")
    return LoadedRun(path.resolve())


def find_runs(logs: str | Path = "logs") -> list[LoadedRun]:
    """All runs below a folder, oldest first; DataError if there is no such folder.

    No link is followed, such as `latest`. A folder that cannot be listed, or lies too deep, may be a run's: it is among them.
    """
    if not Path(logs).is_dir():
        raise DataError(f"there is no folder {logs}; give the one that holds the runs (logs=... of an experiment)")
    found, waiting = [], [str(logs)]
    while waiting:
        folder = waiting.pop()
        try:
            is_run, below = _contents(folder)
        except OSError:
            is_run, below = True, []
        waiting += below
        if is_run:
            found.append(folder)
    return [LoadedRun(Path(folder)) for folder in sorted(found)]


def _contents(folder: str) -> tuple[bool, list[str]]:
    """Whether a folder is a run's, and the folders in it."""
    is_run, below = False, []
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.name == STATUS:
                is_run = True
            elif entry.is_dir(follow_symlinks=False):
                below.append(entry.path)
    return is_run, below
