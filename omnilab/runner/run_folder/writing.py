"""Writing a run folder."""

from __future__ import annotations

import json
import logging
import math
import os
import sys
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from omnilab.api import Metric, Report
from omnilab.errors import DataError, visible
from omnilab.runner.run_folder.latest import check_latest, point_latest
from omnilab.runner.run_folder.lock import RunLock, check_unused
from omnilab.runner.run_folder.names import CONFIG, MANIFEST, METRICS, RUN_LOG, RUNNING, STATUS, WARNINGS
from omnilab.runner.run_folder.tables import number, write_csv

NO_VALUE = "there was nothing to compute it from"


class RunFolder:
    """Writes a run folder: status, manifest and log at the start, results at the end."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._handler: logging.Handler | None = None
        self._warnings = _WarningPrinter()
        self._lock: RunLock | None = None

    def open(self, manifest: Mapping[str, Any], config_yaml: str, latest: Path | None = None) -> None:
        """Create and lock the folder; from here on the run shows up in `omnilab runs`.

        DataError if it cannot be written, or holds a run or other files already.
        """
        if latest is not None:
            check_latest(latest)
        try:
            self._open(manifest, config_yaml, latest)
        except BaseException:
            self.close()
            raise

    def _open(self, manifest: Mapping[str, Any], config_yaml: str, latest: Path | None) -> None:
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            check_unused(self.folder)
            self._lock = RunLock.take(self.folder)
            check_unused(self.folder)  # another run may have begun and ended in between
            (self.folder / CONFIG).write_text(config_yaml, encoding="utf-8")
        except OSError as error:
            raise DataError(
                f"the run folder {self.folder} cannot be written ({error.strerror}); give logs=DIR"
            ) from error
        _write_json(self.folder / MANIFEST, manifest)
        self.status(RUNNING)  # makes it a run: the rest is there
        if latest is not None:
            point_latest(latest, self.folder)
        self._handler = logging.FileHandler(self.folder / RUN_LOG, encoding="utf-8")
        self._handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
        logging.getLogger().addHandler(self._handler)
        logging.getLogger("omnilab").setLevel(logging.INFO)
        logging.getLogger("omnilab").addHandler(self._warnings)

    def status(self, status: str, **more: Any) -> None:
        """Say how the run stands: running, done, failed (with the error) or interrupted."""
        now = datetime.now(UTC).isoformat(timespec="seconds")
        _write_json(self.folder / STATUS, {"status": status, "time": now, "pid": os.getpid(), **more})

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
        """Release the log file and the lock."""
        if self._handler is not None:
            logging.getLogger().removeHandler(self._handler)
            self._handler.close()
            self._handler = None
            logging.getLogger("omnilab").removeHandler(self._warnings)
        if self._lock is not None:
            self._lock.release()
            self._lock = None


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
    return metric.name, number(metric.value), metric.unit, number(low), number(high), note


def _write_json(path: Path, content: Mapping[str, Any]) -> None:
    part = path.with_name(path.name + ".part")
    part.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    part.replace(path)  # a reader never sees half a file
