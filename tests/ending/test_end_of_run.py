"""However a run ends, its status is true, and what was computed is in its folder."""

from __future__ import annotations

import json
import logging
import os
import resource
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from omnilab.api import Metric, Report
from omnilab.errors import DataError, PluginError
from omnilab.runner import interrupts
from omnilab.runner.interrupts import HeldSignals
from omnilab.runner.run_folder import DONE, RunFolder, load_run, status_file

METRICS = "metric,value,unit,low,high,note\nprecious,0.123456789,m,0.1,0.2,\nnothing,,1,,,none\n"
RESULTS = {"metrics.csv", "table.csv", "extra.txt", "first.png", "second.png", "third.png", "cost.csv"}

BUGS = {"bug": ZeroDivisionError, "recursion": RecursionError, "unspeakable": LookupError}


def files_of(folder: Path) -> set[str]:
    return {path.name for path in folder.resolve().iterdir()}


def test_a_run_leaves_its_files_and_nothing_that_was_set_aside(endings, tmp_path):
    result = endings()
    assert (result.rc, result.stderr.count("omnilab:")) == (0, 0)
    title, *lines = result.stdout.splitlines()
    assert title == str((tmp_path / "logs" / "latest").resolve().relative_to(tmp_path))
    assert ["precious", "0.123457", "m", "0.1", "to", "0.2"] in [line.split() for line in lines]
    assert ["nothing", "none"] in [line.split() for line in lines]
    folder = tmp_path / "logs" / "latest"
    assert files_of(folder) >= RESULTS | {"config.yaml", "manifest.json", "run.log", "status.json"}
    assert not [name for name in files_of(folder) if "reserved" in name or name.endswith(".part")]
    assert (folder / "metrics.csv").read_text() == METRICS
    assert load_run(folder).status["status"] == "done"


@pytest.mark.parametrize(
    ("how", "rc", "sentence"),
    [
        ("exit", 2, "tried to end the process (SystemExit: 3)"),
        ("memory", 2, "the run does not fit into memory (Unable to allocate 11.2 GiB"),
        ("full", 2, "/data/frame.png cannot be written (No space left on device); make room there"),
        ("SIGINT", 130, "interrupted"),
        ("SIGTERM", 130, "interrupted"),
        ("SIGHUP", 130, "interrupted"),
        ("twice", 130, "interrupted"),
    ],
)
def test_a_study_that_does_not_end_well(endings, tmp_path, how, rc, sentence):
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
    result = endings(f"study.how={how}")
    assert result.rc == rc, result.stderr
    assert sentence in result.stderr
    assert "Traceback" not in result.stderr
    assert result.stdout == ""
    status = load_run(tmp_path / "logs" / "latest").status["status"]
    assert status == ("interrupted" if rc == 130 else "failed")
    assert "cost.csv" in files_of(tmp_path / "logs" / "latest")
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)] == before


@pytest.mark.parametrize("how", BUGS)
def test_a_bug_is_a_traceback_and_a_true_status(endings, tmp_path, how):
    with pytest.raises(BUGS[how]) as raised:
        endings(f"study.how={how}")
    status = load_run(tmp_path / "logs" / "latest").status
    assert status["status"] == "failed"
    assert status["error"].startswith(raised.type.__name__)


@pytest.mark.parametrize("saving", ["bug", "unspeakable", "exit", "memory", "full"])
def test_a_figure_that_fails_costs_no_other_file(endings, tmp_path, saving):
    if saving in BUGS:
        with pytest.raises(BUGS[saving]):
            endings(f"study.saving={saving}")
    else:
        result = endings(f"study.saving={saving}")
        assert (result.rc, "Traceback" in result.stderr) == (2, False)
    folder = tmp_path / "logs" / "latest"
    assert RESULTS - files_of(folder) == {"second.png"}
    assert load_run(folder).status["status"] == "failed"
    assert (folder / "metrics.csv").read_text() == METRICS


@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM", "SIGHUP", "twice"])
def test_a_signal_while_results_are_written_waits_for_them(endings, tmp_path, number):
    result = endings(f"study.saving={number}")
    assert result.rc == 130
    assert "precious" in result.stdout
    folder = tmp_path / "logs" / "latest"
    assert files_of(folder) >= RESULTS
    assert load_run(folder).status["status"] == "done"


@pytest.mark.parametrize("how", ["bug", "exit", "full", "SIGINT"])
def test_a_sink_that_fails_when_it_is_closed_costs_no_result(endings, tmp_path, how):
    result = endings("+sink@sinks.last=closing", f"sinks.last.how={how}")
    assert result.rc == (130 if how == "SIGINT" else 0), result.stderr
    folder = tmp_path / "logs" / "latest"
    assert files_of(folder) >= RESULTS
    assert load_run(folder).status["status"] == "done"


@pytest.mark.parametrize(
    "name", ["../../escaped.txt", "/escaped.txt", "a/b.txt", "..", ".hidden", "", "nul\0", "metrics.csv", "table.csv", "status.json", "run.log"]
)  # fmt: skip
def test_a_study_names_no_file_elsewhere_and_none_of_the_runs_own(tmp_path, name):
    run = RunFolder(tmp_path / "logs" / "run")
    run.open({"experiment": "x", "overrides": []}, "study: {}\n")
    before = (run.folder / "status.json").read_text()
    run.write(Report([Metric("a", 1, "m")], tables={"table": {"b": [1]}}, files={name: "?", "other.txt": "!"}))
    with pytest.raises(PluginError, match=r"give (tables, figures and files plain names|it another name)"):
        run.check()
    assert (run.folder / "status.json").read_text() == before
    run.end(DONE)
    assert (run.folder / "other.txt").read_text() == "!"
    assert (run.folder / "metrics.csv").read_text().startswith("metric,value")
    assert [path.name for path in tmp_path.iterdir()] == ["logs"]


def test_a_folder_that_is_removed_under_the_run(endings, tmp_path):
    result = endings("study.how=vanish")
    assert (result.rc, "Traceback" in result.stderr) == (2, False)
    assert "precious" in result.stdout
    assert "metrics.csv, table.csv, extra.txt and 4 more could not be written into" in result.stderr
    assert "status.json could not be written (No such file or directory)" in result.stderr
    assert not (tmp_path / "logs").exists()


# ------------------------------------------------------------------------------------------------------- a full disk
@pytest.fixture
def no_file_longer_than() -> Iterator[Any]:
    """`no_file_longer_than(bytes)`: as on a disk that is full, without one (EFBIG)."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.getsignal(signal.SIGXFSZ)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    signal.signal(signal.SIGXFSZ, handler)


def opened(folder: Path) -> RunFolder:
    run = RunFolder(folder)
    run.open({"experiment": "grid", "overrides": []}, "study: {}\n")
    return run


def test_what_can_be_written_is_and_the_rest_is_said(tmp_path, no_file_longer_than):
    run = opened(tmp_path / "run")
    report = Report(
        [Metric("precious", 0.5, "m")],
        tables={"long": {"x": list(range(5000))}, "short": {"x": [1]}},
        files={"a.txt": "b" * 5000, "b.txt": "c"},
    )
    no_file_longer_than(4000)
    run.write(report)
    with pytest.raises(DataError) as said:
        run.check()
    run.end("failed", error=str(said.value))
    assert str(said.value) == (
        f"long.csv, a.txt could not be written into {run.folder} (File too large); make room there, then"
        f" omnilab repeat {run.folder}"
    )
    assert files_of(run.folder) == {
        "config.yaml", "manifest.json", "status.json", "run.log", "run.lock", "metrics.csv", "short.csv", "b.txt"
    }  # fmt: skip
    assert load_run(run.folder).status["error"] == str(said.value)


def test_the_last_status_needs_no_room(tmp_path, monkeypatch):
    run = opened(tmp_path / "run")
    monkeypatch.setattr(status_file, "write_text", None)  # no other file may be made
    run.end("failed", error="x" * 10**6, sinks_dropped={"mcap": "y" * 10**6})
    status = load_run(run.folder).status
    assert status["status"] == "failed"
    assert status["error"].startswith("xxx")
    assert len((run.folder / "status.json").read_bytes()) < status_file.LEAST


def test_a_folder_that_cannot_be_begun_is_left_as_it_was(tmp_path, no_file_longer_than):
    no_file_longer_than(4000)
    with pytest.raises(DataError, match=r"cannot be written \(File too large\); make room there, or give logs=DIR"):
        opened(tmp_path / "run")
    assert files_of(tmp_path / "run") <= {"run.lock"}


def test_a_log_that_cannot_be_written_is_said_once(tmp_path, no_file_longer_than, capfd):
    run = opened(tmp_path / "run")
    capfd.readouterr()
    no_file_longer_than(2000)
    for _ in range(300):
        logging.getLogger("omnilab").info("a line of the log")
    run.end(DONE)
    err = capfd.readouterr().err
    assert "run.log ends here (File too large)" in err
    assert err.count("\n") == 1
    assert json.loads((run.folder / "status.json").read_text())["status"] == "done"


# ----------------------------------------------------------------------------------------------------------- signals
def test_signals_wait_except_where_they_are_heard():
    own = signal.getsignal(signal.SIGTERM)
    reached = []
    with pytest.raises(KeyboardInterrupt), HeldSignals() as signals:  # noqa: PT012
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.02)
        reached.append("held")
        with signals.heard():
            reached.append("never")
    assert reached == ["held"]
    assert signal.getsignal(signal.SIGTERM) is own


def test_a_signal_that_waited_ends_what_comes_after():
    reached = []
    with pytest.raises(KeyboardInterrupt), HeldSignals():  # noqa: PT012
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.02)
        reached.append("whole")
    assert reached == ["whole"]


def test_what_hangs_can_be_ended(monkeypatch):
    monkeypatch.setattr(interrupts, "PATIENCE_S", 0.05)
    with pytest.raises(KeyboardInterrupt), HeldSignals():  # noqa: PT012
        for _ in range(100):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.02)
        pytest.fail("it never ended")


@pytest.mark.parametrize("before", [signal.SIG_IGN, signal.SIG_DFL])
def test_a_terminal_that_goes_away_ends_no_run_under_nohup(before):
    own = signal.signal(signal.SIGHUP, before)
    try:
        with HeldSignals():
            hears = signal.getsignal(signal.SIGHUP) is not before
        assert hears == (before is signal.SIG_DFL)
        assert signal.getsignal(signal.SIGHUP) == before
    finally:
        signal.signal(signal.SIGHUP, own)


def test_a_disk_without_links_is_told_and_the_run_goes_on(endings, tmp_path, monkeypatch):
    def refused(*_: object, **__: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(Path, "symlink_to", refused)
    result = endings()
    assert result.rc == 0
    assert "logs/latest cannot be made (Operation not permitted); give the run's folder, " in result.stderr
    (folder,) = (tmp_path / "logs" / "pose_graph").iterdir()
    assert load_run(folder).status["status"] == "done"


def test_a_process_with_too_many_open_files_has_its_last_status(endings, tmp_path):
    """The first of a run's files that cannot be opened is its metrics."""
    result = endings("study.how=files")
    assert result.rc == 2
    assert "Traceback" not in result.stderr
    assert "precious" in result.stdout
    assert "metrics.csv, table.csv, extra.txt and 4 more could not be written into" in result.stderr
    status = load_run(tmp_path / "logs" / "latest").status
    assert (status["status"], "Too many open files" in status["error"]) == ("failed", True)
