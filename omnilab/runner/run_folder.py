"""The run folder: what a run leaves behind, and reading it again."""

from __future__ import annotations

import csv
import io
import json
import logging
import math
import os
import platform
import secrets
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

from omnilab.api import Metric, Report
from omnilab.atomic_files import is_process
from omnilab.errors import DataError, visible

METRICS = ["metric", "value", "unit", "low", "high", "note"]  # the columns of metrics.csv
WARNINGS = "warnings.txt"
NO_VALUE = "there was nothing to compute it from"
RUNNING, DONE, FAILED, INTERRUPTED, KILLED = "running", "done", "failed", "interrupted", "killed"
UNREADABLE = "unreadable"  # what a damaged run is listed as


class RunFolder:
    """Writes a run folder: status, manifest and log at the start, results at the end."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._handler: logging.Handler | None = None
        self._warnings = _WarningPrinter()

    def open(self, manifest: Mapping[str, Any], config_yaml: str, latest: Path | None = None) -> None:
        """Create the folder; from here on the run shows up in `omnilab runs`."""
        if latest is not None:
            _check_latest(latest)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            (self.folder / "config.yaml").write_text(config_yaml, encoding="utf-8")
        except OSError as error:
            raise DataError(
                f"the run folder {self.folder} cannot be written ({error.strerror}); give logs=DIR"
            ) from error
        _write_json(self.folder / "manifest.json", manifest)
        self.status(RUNNING)  # makes it a run: the rest is there
        if latest is not None:
            point_latest(latest, self.folder)
        self._handler = logging.FileHandler(self.folder / "run.log", encoding="utf-8")
        self._handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
        logging.getLogger().addHandler(self._handler)
        logging.getLogger("omnilab").setLevel(logging.INFO)
        logging.getLogger("omnilab").addHandler(self._warnings)

    def status(self, status: str, **more: Any) -> None:
        """Say how the run stands: running, done, failed (with the error) or interrupted."""
        now = datetime.now(UTC).isoformat(timespec="seconds")
        _write_json(self.folder / "status.json", {"status": status, "time": now, "pid": os.getpid(), **more})

    def write(self, report: Report, warnings: Iterable[str] = ()) -> None:
        """Metrics, tables, figures and files; in `warnings.txt` what is to be known before they are believed."""
        write_csv(self.folder / "metrics.csv", METRICS, map(_metric_row, report.metrics))
        if lines := [" ".join(warning.split()) for warning in warnings]:
            (self.folder / WARNINGS).write_text("\n".join(lines) + "\n", encoding="utf-8")
        for name, table in report.tables.items():
            write_csv(self.folder / f"{name}.csv", list(table), zip(*table.values(), strict=True))
        for name, figure in report.figures.items():
            figure.savefig(self.folder / f"{name}.png")
        for name, text in report.files.items():
            (self.folder / name).write_text(text, encoding="utf-8")

    def write_costs(self, rows: Iterable[tuple[str, float, str]]) -> None:
        """Times, memory, bytes: what depends on the machine."""
        write_csv(self.folder / "cost.csv", ["cost", "value", "unit"], ((n, f"{v:.6g}", u) for n, v, u in rows))

    def close(self) -> None:
        """Release the log file."""
        if self._handler is not None:
            logging.getLogger().removeHandler(self._handler)
            self._handler.close()
            self._handler = None
            logging.getLogger("omnilab").removeHandler(self._warnings)


class _WarningPrinter(logging.Handler):
    """Prints warnings, which the log of a run keeps, each once. Errors are printed where they end the run."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._printed: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        sentence = record.getMessage()
        if record.levelno == logging.WARNING and sentence not in self._printed:
            self._printed.add(sentence)
            sys.stderr.write(f"omnilab: {visible(sentence)}\n")


def _metric_row(metric: Metric) -> tuple[str, ...]:
    """A line of `metrics.csv`: a metric without a value is empty, and its note says why."""
    low, high = metric.interval or (math.nan, math.nan)
    if math.isnan(low) or math.isnan(high):
        low = high = math.nan
    note = (metric.note or NO_VALUE) if math.isnan(metric.value) else ""
    return metric.name, _number(metric.value), metric.unit, _number(low), _number(high), note


def _number(value: Any) -> str:
    """The shortest text that reads back as the same number; empty for NaN."""
    number = float(value)
    if math.isnan(number):
        return ""
    return str(int(number)) if number.is_integer() and abs(number) < 2**53 else repr(number)


def write_csv(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """A CSV file in UTF-8; floats are written so that they read back exactly."""
    with path.open("w", newline="", encoding="utf-8") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


def _write_json(path: Path, content: Mapping[str, Any]) -> None:
    part = path.with_name(path.name + ".part")
    part.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    part.replace(path)  # a reader never sees half a file


def new_folder_name() -> str:
    """`<date>_<time>-<hex>`: the hex parts runs that start in the same second."""
    return f"{datetime.now().astimezone():%Y-%m-%d_%H-%M-%S}-{secrets.token_hex(3)}"


def _check_latest(link: Path) -> None:
    """DataError where something of the user's lies in the place of the link."""
    if link.exists() and not link.is_symlink():
        kind = "folder" if link.is_dir() else "file"
        raise DataError(
            f"{link} is a {kind}, and a link to the newest run belongs there; rename the {kind}, or give another logs=DIR"
        )


def point_latest(link: Path, folder: Path) -> None:
    """Make the link point at the folder, atomically, by a relative path."""
    link.parent.mkdir(parents=True, exist_ok=True)
    part = link.with_name(f".latest-{secrets.token_hex(4)}")
    part.symlink_to(os.path.relpath(folder.resolve(), link.parent.resolve()))
    part.replace(link)


def origin() -> dict[str, Any]:
    """Where and with what a run was made: commit, Python, host."""
    return {
        "commit": _commit(),
        "python": platform.python_version(),
        "host": {"name": platform.node(), "system": platform.platform(), "cores": os.cpu_count()},
        "command": [Path(sys.argv[0]).name, *sys.argv[1:]],
    }


def _commit() -> str | None:
    """The commit of the source tree that omnilab runs from, with "+changes" if it was edited; None if installed."""
    source = Path(__file__).resolve().parent.parent.parent
    if not (source / ".git").exists():
        return None
    git = ["git", "-C", str(source)]
    try:
        head = subprocess.run([*git, "rev-parse", "HEAD"], capture_output=True, text=True, timeout=5, check=True)
        changes = subprocess.run(
            [*git, "status", "--porcelain", "-uno"], capture_output=True, text=True, timeout=5, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return head.stdout.strip() + ("+changes" if changes.stdout.strip() else "")


# --------------------------------------------------------------------------------------------------- reading runs
@dataclass(frozen=True)
class LoadedRun:
    """A run folder, read."""

    folder: Path

    @cached_property
    def status(self) -> dict[str, Any]:
        return self._read("status.json", json.loads, status=str, pid=int)

    @cached_property
    def manifest(self) -> dict[str, Any]:
        content = self._read("manifest.json", json.loads, experiment=str, overrides=list)
        if not all(isinstance(override, str) for override in content["overrides"]):
            raise self._unreadable("manifest.json", "overrides should be a list of texts")
        return content

    @cached_property
    def config(self) -> dict[str, Any]:
        """The resolved configuration."""
        return self._read("config.yaml", _yaml, study=dict)

    @cached_property
    def metrics(self) -> dict[str, float]:
        """By name. Empty for a run that did not finish."""
        return {row["metric"]: self._metric(row, "value") for row in self._metric_rows}

    @cached_property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """95 % confidence of the metrics for which it was estimated."""
        rows = [row for row in self._metric_rows if row.get("low")]
        return {row["metric"]: (self._metric(row, "low"), self._metric(row, "high")) for row in rows}

    @cached_property
    def notes(self) -> dict[str, str]:
        """Why there is no value, of the metrics without one."""
        return {row["metric"]: row["note"] for row in self._metric_rows if row.get("note")}

    @cached_property
    def units(self) -> dict[str, str]:
        return {row["metric"]: row["unit"] for row in self._metric_rows}

    @cached_property
    def _metric_rows(self) -> list[dict[str, str]]:
        rows = self.table("metrics")
        if rows and not rows[0].keys() >= {"metric", "value", "unit"}:
            raise self._unreadable("metrics.csv", "its columns should be metric, value, unit")
        return rows

    def _metric(self, row: Mapping[str, str], column: str) -> float:
        if row.get(column) == "" and row.get("note"):
            return math.nan
        try:
            return float(row[column])
        except (KeyError, ValueError) as error:
            raise self._unreadable("metrics.csv", f"{column} of {row['metric']} is no number") from error

    def table(self, name: str) -> list[dict[str, str]]:
        """The rows of one CSV file of the run; none if it was not written. DataError if it is damaged."""
        path = self.folder / f"{name}.csv"
        if not path.exists():
            return []
        header, *rows = self._parse(path.name, _csv_rows)
        return [dict(zip(header, row, strict=True)) for row in rows]

    @property
    def alive(self) -> bool:
        """Whether the run's process is still there."""
        return is_process(self.status["pid"])

    @property
    def state(self) -> str:
        """The status, where a run that says "running" but has no process was killed."""
        status = str(self.status["status"])
        return KILLED if status == RUNNING and not self.alive else status

    def _read(self, name: str, parse: Callable[[str], Any], **types: type) -> dict[str, Any]:
        """A file of the run that must be a mapping with these keys and types of content; DataError if it is not."""
        content = self._parse(name, parse)
        if not isinstance(content, dict) or not content.keys() >= types.keys():
            raise self._unreadable(name, f"it should hold {', '.join(types)}")
        for key, wanted in types.items():
            if type(content[key]) is not wanted:
                raise self._unreadable(name, f"its {key} is {content[key]!r:.60}")
        return content

    def _parse(self, name: str, parse: Callable[[str], Any]) -> Any:
        path = self.folder / name
        try:
            if path.exists() and not path.is_file():  # a FIFO would never end
                raise OSError("it is no file")
            return parse(path.read_text(encoding="utf-8"))
        except Exception as error:
            raise self._unreadable(name, _why(error)) from error

    def _unreadable(self, name: str, why: object) -> DataError:
        reason = " ".join(str(why).split())
        return DataError(
            f"{self.folder / name} cannot be read ({reason}); remove the folder, or run the experiment again"
        )


def _csv_rows(text: str) -> list[list[str]]:
    """Header and rows of a CSV file; ValueError if it is torn."""
    if not text.endswith("\n"):
        raise ValueError("it ends within a line")
    rows = list(csv.reader(io.StringIO(text, newline=""), strict=True))
    if any(len(row) != len(rows[0]) for row in rows):
        raise ValueError("a row has more or fewer values than the first line has names")
    return rows


def _yaml(text: str) -> Any:
    """The content of a YAML file; ValueError if it has aliases, which none of ours has and which fill any memory."""
    import yaml

    if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, Loader=yaml.SafeLoader)):
        raise ValueError("it has an alias")
    return yaml.safe_load(text)


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
    if not (path / "status.json").is_file():
        jobs = (
            f", but the jobs of a sweep: give one, such as {path / '0'}"
            if (path / "0" / "status.json").is_file()
            else ""
        )
        raise DataError(f"{path} holds no run (no status.json){jobs}; `omnilab runs` lists the runs there are")
    return LoadedRun(path.resolve())


def find_runs(logs: str | Path = "logs") -> list[LoadedRun]:
    """All runs below a folder, oldest first; DataError if there is no such folder."""
    if not Path(logs).is_dir():
        raise DataError(f"there is no folder {logs}; give the one that holds the runs (logs=... of an experiment)")
    files = Path(logs).rglob("status.json")  # which follows no link, such as `latest`
    return [LoadedRun(f.parent) for f in sorted(files, key=lambda f: f.parent.as_posix())]


def write_summary(folder: Path) -> tuple[list[str], list[list[str]]]:
    """`summary.csv` of a sweep: one row a job, its overrides and metrics as columns. Returns header and rows."""
    runs = sorted(find_runs(folder), key=lambda run: int(run.folder.name) if run.folder.name.isdigit() else 0)
    jobs = [(run.folder.name, *_job(run)) for run in runs]
    keys = list(dict.fromkeys(key for _, overrides, _, _ in jobs for key in overrides))
    metrics = list(dict.fromkeys(name for *_, found in jobs for name in found))
    rows = [
        [name, *(overrides.get(key, "") for key in keys), state]
        + [_number(found[metric]) if metric in found else "" for metric in metrics]
        for name, overrides, state, found in jobs
    ]
    header = ["job", *keys, "status", *metrics]
    write_csv(folder / "summary.csv", header, rows)
    return header, rows


def _job(run: LoadedRun) -> tuple[dict[str, str], str, dict[str, float]]:
    """Overrides, state and metrics of a sweep's job; one that is damaged hides no other."""
    try:
        return dict(o.split("=", 1) for o in run.manifest["overrides"] if "=" in o), run.state, run.metrics
    except DataError:
        return {}, UNREADABLE, {}
