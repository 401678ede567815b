"""A disk that fills up: what was computed is printed, what fits is written, the status is true, and so is the list of runs."""

from __future__ import annotations

import csv
import errno
import json
from pathlib import Path

import pytest

from omnilab.runner import hydra_app
from omnilab.runner.run_folder import load_run

METRICS = "metric,value,unit,low,high,note\nprecious,0.123456789,m,0.1,0.2,\nnothing,,1,,,none\n"
NOISE = ("Traceback", "Exception ignored", "Logging error", "Errno")
NO_ROOM = "(No space left on device)"


def latest(tmp_path: Path) -> Path:
    return tmp_path / "kept" / (tmp_path / "kept" / "latest").readlink()


def check_sentence(stderr: str) -> str:
    """The last line, which is one of ours; nothing else is noise."""
    assert not [word for word in NOISE if word in stderr], stderr
    last = stderr.splitlines()[-1]
    assert last.startswith("omnilab: ")
    return last


def test_a_disk_that_the_run_fills(in_shell, tmp_path):
    """The room that was set aside holds the metrics; the first figure is larger."""
    ended = in_shell("{omnilab} study.how=fill", disk="1m")
    assert ended.rc == 2, ended.stderr
    assert "precious" in ended.stdout
    said = check_sentence(ended.stderr)
    assert f"first.png could not be written into {tmp_path}/logs/pose_graph/" in said
    assert f"{NO_ROOM}; make room there, then omnilab repeat {tmp_path}/logs/pose_graph/" in said
    folder = latest(tmp_path)
    assert (folder / "metrics.csv").read_text() == METRICS
    assert (folder / "table.csv").read_text() == "a,b\n1,0.5\n2,0.25\n"
    status = load_run(folder).status
    assert status["status"] == "failed"
    assert said.endswith(status["error"].removeprefix("DataError: "))
    assert not [path.name for path in folder.iterdir() if path.name.endswith(".part")]


@pytest.mark.slow
def test_the_same_with_both_logs(in_shell, tmp_path):
    """They grow until they are dropped, and so does the log; the disk has 300 kB."""
    ended = in_shell("{omnilab} study.how=fill +sink@sinks.rerun=rerun +sink@sinks.mcap=mcap", disk="300k")
    assert ended.rc == 2, ended.stderr
    assert "precious" in ended.stdout
    assert "Traceback" not in ended.stderr
    assert (latest(tmp_path) / "metrics.csv").read_text() == METRICS
    assert load_run(latest(tmp_path)).status["status"] == "failed"


def test_a_disk_without_room_for_a_run(in_shell, tmp_path):
    ended = in_shell("{omnilab}", disk="8k")
    assert (ended.rc, ended.stdout) == (2, "")
    assert f"cannot be written {NO_ROOM}" in check_sentence(ended.stderr)
    assert not list((tmp_path / "kept").rglob("status.json"))


@pytest.mark.slow
def test_a_map_that_is_too_large_costs_nothing_else(in_shell, tmp_path):
    ended = in_shell("{omnilab} study.map_mb=3", disk="2m")
    assert ended.rc == 2
    assert "map.npz could not be written into" in check_sentence(ended.stderr)
    folder = latest(tmp_path)
    names = {path.name for path in folder.iterdir()}
    assert names >= {"metrics.csv", "table.csv", "extra.txt", "first.png", "second.png", "third.png", "cost.csv"}
    assert not [name for name in names if name.startswith("map.npz")]
    assert load_run(folder).status["status"] == "failed"


@pytest.mark.slow
def test_a_sweep_on_a_disk_that_fills_up(in_shell, tmp_path):
    """Its second job fills the disk; the third cannot begin; the room of the second's status holds their table."""
    ended = in_shell("{omnilab} -m study.how=well,fill,SIGCONT", disk="2m")
    assert ended.rc == 1, ended.stderr
    assert (
        check_sentence(ended.stderr)
        == "omnilab: 2 of 3 jobs did not end well; the lines above say why, and so does the status.json of each"
    )
    (sweep,) = (tmp_path / "kept" / "pose_graph").iterdir()
    assert {job.name: load_run(job).state for job in sweep.iterdir() if (job / "status.json").exists()} == {
        "0": "done", "1": "failed"
    }  # fmt: skip
    rows = list(csv.DictReader((sweep / "summary.csv").read_text().splitlines()))
    assert [(row["study.how"], row["status"], row["precious"]) for row in rows] == [
        ("well", "done", "0.123456789"), ("fill", "failed", "0.123456789"), ("SIGCONT", "failed", "")
    ]  # fmt: skip
    assert ended.stdout.count("precious") == 2, "the job's own table, and the sweep's"
    assert "job 1: precious 0.1235" in ended.stderr


def test_a_table_of_a_sweep_that_cannot_be_written_is_printed_whole(endings, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(hydra_app, "write_csv", full)
    result = endings("-m", "study.value=1,2")
    assert result.rc == 2
    whole = [line.split() for line in result.stdout.partition("the whole table")[2].splitlines()]
    assert [(line[0], line[-3:]) for line in whole[-2:]] == [("0", ["1", "done", "1"]), ("1", ["2", "done", "2"])]
    assert "cannot be written (No space left on device), so the whole table was printed" in check_sentence(
        result.stderr
    )


@pytest.mark.slow
def test_the_next_run_works_and_all_is_listed(in_shell, tmp_path):
    line = "{omnilab} study.how=fill; {command} runs; {command} repair; rm logs/filler; {command} runs; {omnilab}"
    ended = in_shell(line, disk="1m")
    assert ended.rc == 0, ended.stderr
    assert ended.stdout.count(" failed ") == 2
    assert load_run(latest(tmp_path)).status["status"] == "done"


def test_a_study_on_a_full_disk_of_its_own(endings, tmp_path):
    result = endings("-m", "study.how=well,full,exit,memory")
    assert result.rc == 1
    assert "Traceback" not in result.stderr
    (sweep,) = (tmp_path / "logs" / "pose_graph").iterdir()
    rows = list(csv.DictReader((sweep / "summary.csv").read_text().splitlines()))
    assert [row["status"] for row in rows] == ["done", "failed", "failed", "failed"]
    assert json.loads((sweep / "1" / "status.json").read_text())["error"].startswith("OSError")
