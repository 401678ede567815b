"""A metric without a value is empty, never NaN, and says why; warnings of a study are in the run's folder."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import pytest

from omnilab.api import Metric, Record, Report, Text, Tick
from omnilab.errors import DataError
from omnilab.runner.execute import _log_results
from omnilab.runner.recorder import Recorder
from omnilab.runner.run_folder import DONE, RunFolder, load_run
from omnilab.runner.sweeps import load_sweep
from omnilab.runner.sweeps.table import table
from omnilab.runner.terminal import headline, show_run

NAN = math.nan
REPORT = Report(
    [
        Metric("closure_precision", NAN, "1", note="no loop was closed"),
        Metric("rate", 0.1 + 0.2, "1", (0.25, NAN)),
        Metric("error", NAN, "m", (NAN, NAN)),
        Metric("far", math.inf, "m", note="not shown where there is a value"),
    ]
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A run with metrics that have no value, as the job of a sweep."""
    run = RunFolder(tmp_path / "0")
    run.open({"experiment": "grid", "overrides": ["seed=0"]}, "study: {}\n")
    run.write(REPORT, ["two\nlines of a warning", "another"])
    run.status(DONE)
    run.close()
    return run.folder


def test_it_is_empty_in_the_file_with_the_reason(folder: Path) -> None:
    with (folder / "metrics.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows == [
        ["metric", "value", "unit", "low", "high", "note"],
        ["closure_precision", "", "1", "", "", "no loop was closed"],
        ["rate", "0.30000000000000004", "1", "", "", ""],
        ["error", "", "m", "", "", "there was nothing to compute it from"],
        ["far", "inf", "m", "", "", ""],
    ]


def test_it_is_nan_when_it_is_read_again(folder: Path) -> None:
    run = load_run(folder)
    assert list(run.metrics) == ["closure_precision", "rate", "error", "far"]
    assert math.isnan(run.metrics["closure_precision"])
    assert run.metrics["rate"] == 0.1 + 0.2
    assert run.notes == {
        "closure_precision": "no loop was closed",
        "error": "there was nothing to compute it from",
    }


def test_an_empty_value_without_a_reason_is_damage(folder: Path) -> None:
    file = folder / "metrics.csv"
    file.write_text(file.read_text().replace("no loop was closed", ""))
    with pytest.raises(DataError, match="value of closure_precision is no number"):
        _ = load_run(folder).metrics


def test_it_is_shown_with_the_reason(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    show_run(REPORT, folder)
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["closure_precision", "no", "loop", "was", "closed"] in lines
    assert headline(load_run(folder).metrics) == "closure_precision –, rate 0.3, error –"
    header, rows = table(load_sweep(folder.parent).jobs)
    assert rows[0][header.index("closure_precision")] == ""
    assert "nan" not in rows[0]


def test_warnings_are_in_the_folder_a_line_each(folder: Path) -> None:
    assert (folder / "warnings.txt").read_text() == "two lines of a warning\nanother\n"


def test_the_recorder_keeps_warnings_once_with_and_without_sinks() -> None:
    record = Recorder()
    for text in ("a", "b", "a"):
        record.log("log", Text(text, "WARN"))
    record.log("log", Text("c"))
    assert list(record.warnings) == ["a", "b"]


def test_a_run_without_warnings_has_no_such_file(tmp_path: Path) -> None:
    run = RunFolder(tmp_path / "run")
    run.open({"experiment": "grid", "overrides": []}, "study: {}\n")
    run.write(Report([Metric("rate", 1, "1")]), Recorder().warnings)
    run.close()
    assert not (run.folder / "warnings.txt").exists()


def test_warnings_stand_above_the_results_in_the_viewer() -> None:
    shown: list[str] = []

    class Keeps(Recorder):
        def log(self, path: str, record: Record, tick: Tick | None = None) -> None:
            super().log(path, record, tick)
            if path == "summary" and isinstance(record, Text):
                shown.append(record.text)

    record = Keeps()
    _log_results(Report([], summary="## Results"), record)
    for i in range(5):
        record.log("log", Text(f"warning\n{i}", "WARN"))
    _log_results(Report([], summary="## Results"), record)
    first, second = shown
    assert first == "## Results"
    lines = [f"> **Warning**: warning {i}" for i in range(3)]
    assert second == "\n>\n".join([*lines, "> 2 more are in `warnings.txt`."]) + "\n\n## Results"
