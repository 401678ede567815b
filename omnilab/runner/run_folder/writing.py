"""Writing a run folder."""

from __future__ import annotations

import io
import json
import logging
import math
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

from omnilab.api import Metric, Report
from omnilab.atomic_files import write_whole
from omnilab.errors import DataError, PluginError
from omnilab.runner.run_folder import status_file
from omnilab.runner.run_folder.latest import check_latest, point_latest
from omnilab.runner.run_folder.lock import LOCK, RunLock, check_unused
from omnilab.runner.run_folder.names import CONFIG, MANIFEST, METRICS, RESERVED, RUN_LOG, RUNNING, STATUS, WARNINGS
from omnilab.runner.run_folder.run_log import RunLog
from omnilab.runner.run_folder.tables import number, write_csv, write_text

NO_VALUE = "there was nothing to compute it from"
METRICS_FILE = "metrics.csv"
SHOWN = 3  # names of files in a sentence

log = logging.getLogger("omnilab")


class RunFolder:
    """Writes a run folder: status, manifest and log at the start, results at the end."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.missing: dict[str, BaseException] = {}  # files that could not be written
        self._log: RunLog | None = None
        self._lock: RunLock | None = None
        self._reserved: BinaryIO | None = None  # room for the last status

    def open(self, manifest: Mapping[str, Any], config_yaml: str, latest: Path | None = None) -> None:
        """Create and lock the folder; from here on the run shows up in `omnilab runs`.

        DataError if it cannot be written, or holds a run or other files already.
        """
        if latest is not None:
            check_latest(latest)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            check_unused(self.folder)
            self._lock = RunLock.take(self.folder)
            check_unused(self.folder)  # another run may have begun and ended in between
            self._begin(manifest, config_yaml, latest)
        except BaseException as error:
            self.close()
            if not isinstance(error, OSError):
                raise
            raise DataError(
                f"the run folder {self.folder} cannot be written ({error.strerror}); make room there, or give logs=DIR"
            ) from error

    def _begin(self, manifest: Mapping[str, Any], config_yaml: str, latest: Path | None) -> None:
        """Write what makes the locked folder a run, or nothing."""
        try:
            write_text(self.folder / CONFIG, config_yaml)
            write_text(self.folder / MANIFEST, json.dumps(manifest, indent=2) + "\n")
            self.status(RUNNING)  # makes it a run: the rest is there
            self._reserved = status_file.reserve(self.folder)
            self._log = RunLog(self.folder)
            if self._lock is not None and not self._lock.flock:
                log.info("this disk cannot lock %s: whether the run lives is told by its heartbeat alone", LOCK)
            if latest is not None:
                point_latest(latest, self.folder)
        except BaseException:
            for name in (STATUS, RESERVED, RUN_LOG, MANIFEST, CONFIG):
                (self.folder / name).unlink(missing_ok=True)
            raise

    def status(self, status: str, **more: Any) -> None:
        """Say how the run stands: running, done, failed (with the error) or interrupted."""
        reserved, self._reserved = self._reserved, None
        status_file.write_status(self.folder, status, reserved, **more)

    def write(
        self, report: Report, warnings: Iterable[str] = (), others: Mapping[str, Callable[[], object]] | None = None
    ) -> None:
        """Metrics, tables, texts and figures; in `warnings.txt` what is to be known before they are believed.

        Then what `others` write, by file name. One that cannot be written is `missing`, and costs no other.
        """
        if self._reserved is not None:
            status_file.release(self._reserved)
        taken = _names(self.folder)
        for name, write in _results(report, warnings):
            self.attempt(name, lambda name=name, write=write: write(self._new_file(name, taken)))  # type: ignore[misc]
        for name, save in (others or {}).items():
            self.attempt(name, save)

    def _new_file(self, name: str, taken: set[str]) -> Path:
        """A file of this name; PluginError if there is one already, or it would lie elsewhere."""
        if not name or name.startswith(".") or any(c in name for c in "/\\\0"):
            raise PluginError(f"the study names a file {name!r}; give tables, figures and files plain names")
        if name in taken:
            raise PluginError(f"the study names a file '{name}', which the run has already; give it another name")
        taken.add(name)
        return self.folder / name

    def write_costs(self, rows: Iterable[tuple[str, float, str]]) -> None:
        """Times, memory, bytes: what depends on the machine."""
        table = ((name, f"{value:.6g}", unit) for name, value, unit in rows)
        self.attempt("cost.csv", lambda: write_csv(self.folder / "cost.csv", ["cost", "value", "unit"], table))

    def attempt(self, name: str, write: Callable[[], object]) -> None:
        """Write one file, or note that it is missing."""
        try:
            write()
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # also a figure that would end the process costs no other file
            self.missing[name] = error
            why = error.strerror if isinstance(error, OSError) else type(error).__name__
            log.info("%s could not be written (%s)", name, why, exc_info=not isinstance(error, OSError))

    def check(self) -> None:
        """Raise what kept files from being written, if any are missing: a DataError if that was the disk."""
        for error in self.missing.values():
            if not isinstance(error, OSError):
                raise error
        if self.missing:
            names, why = list(self.missing), next(iter(self.missing.values()))
            more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
            again = "run it again" if METRICS_FILE in names else f"omnilab repeat {shlex.quote(str(self.folder))}"
            raise DataError(
                f"{', '.join(names[:SHOWN])}{more} could not be written into {self.folder}"
                f" ({getattr(why, 'strerror', None) or why}); make room there, then {again}"
            )

    def end(self, status: str, **more: Any) -> None:
        """Say how the run ended, and release the log file."""
        try:
            self.status(status, **more)
        except OSError as error:
            log.warning(
                "%s could not be written (%s), so the run will be listed as killed",
                self.folder / STATUS,
                error.strerror,
            )
        self.close()

    def close(self) -> None:
        """Release the files and the lock."""
        if self._reserved is not None:
            self._reserved.close()
            self._reserved = None
        if self._log is not None:
            self._log.close()
            self._log = None
        if self._lock is not None:
            self._lock.release()
            self._lock = None


def _names(folder: Path) -> set[str]:
    """What is in a folder; nothing if it was removed, or cannot be opened: then nothing is written, either."""
    try:
        return {path.name for path in folder.iterdir()}
    except OSError:
        return set()


def _results(report: Report, warnings: Iterable[str]) -> Iterator[tuple[str, Callable[[Path], None]]]:
    """What to write, the most precious first, by file name."""
    yield METRICS_FILE, lambda path: write_csv(path, METRICS, map(metric_row, report.metrics))
    if lines := [" ".join(warning.split()) for warning in warnings]:
        yield WARNINGS, lambda path: write_text(path, "\n".join(lines) + "\n")
    for name, table in report.tables.items():
        yield f"{name}.csv", lambda path, t=table: write_csv(path, list(t), zip(*t.values(), strict=True))  # type: ignore[misc]
    for name, text in report.files.items():
        yield name, lambda path, text=text: write_text(path, text)  # type: ignore[misc]
    for name, figure in report.figures.items():
        yield f"{name}.png", lambda path, figure=figure: _write_png(path, figure)  # type: ignore[misc]


def _write_png(path: Path, figure: Any) -> None:
    picture = io.BytesIO()
    figure.savefig(picture, format="png")
    write_whole(path, lambda out: out.write(picture.getbuffer()))


def metric_row(metric: Metric) -> tuple[str, ...]:
    """A line of `metrics.csv`: a metric without a value is empty, and its note says why."""
    low, high = metric.interval or (math.nan, math.nan)
    if math.isnan(low) or math.isnan(high):
        low = high = math.nan
    note = (metric.note or NO_VALUE) if math.isnan(metric.value) else ""
    return metric.name, number(metric.value), metric.unit, number(low), number(high), note
