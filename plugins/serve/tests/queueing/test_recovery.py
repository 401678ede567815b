"""A queue whose process is killed, at any step of a submission: nothing is lost, and nothing is run twice."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from queue_for_tests import until

from omnilab.errors import DataError
from omnilab_serve.queue import RunQueue, commands, recovery, run_queue, submission_store
from omnilab_serve.queue.children import lives
from omnilab_serve.queue.submission_file import Attempt, SubmissionFile, now

DOOMED = Path(__file__).parent / "doomed_queue.py"
Starts = Callable[..., RunQueue]


def die_at(step: str, place: Any, *overrides: str) -> None:
    """Two submissions, and a queue that is killed at a step of the first."""
    died = subprocess.run([sys.executable, str(DOOMED), str(place.logs), step, *overrides], check=False)
    assert died.returncode == -signal.SIGKILL


def states(queue: RunQueue) -> list[str]:
    return [one.state for one in queue.submissions()]


@pytest.mark.parametrize("step", ["file", "locked", "started", "named", "waiting", "ended"])
def test_each_is_run_once_wherever_the_service_is_killed(step: str, place: Any, start: Starts) -> None:
    die_at(step, place, *([f"wait={place.go}"] if step != "ended" else []))
    assert len(list(place.logs.glob(".queue/*.json"))) == 2
    queue = start()
    place.go.touch()
    until(lambda: states(queue) == ["done", "done"])
    assert sorted(place.started().values()) == [1, 1]
    assert [one.attempt for one in queue.submissions()] == [1, 1]
    assert {line.rpartition("/")[2].strip("'") for line in place.lines()} == {
        run.parent.name for run in place.logs.glob("quick/*/status.json")
    }


@pytest.mark.parametrize("step", ["started", "named"])
def test_what_still_runs_keeps_its_worker(step: str, place: Any, start: Starts) -> None:
    die_at(step, place, f"wait={place.go}")
    queue = start(workers=1)
    until(lambda: place.lines() and all(r.starts[-1].process for r in queue._records.values() if r.state == "running"))
    assert sorted(states(queue)) == ["queued", "running"]
    assert len(place.lines()) == 1
    first = next(one for one in queue.submissions() if one.state == "running")
    queue.cancel(first.id)
    until(lambda: queue.submission(first.id).state == "interrupted")  # type: ignore[union-attr]
    until(lambda: len(place.lines()) == 2)


def test_a_run_that_is_gone_is_begun_again_in_a_new_folder(place: Any, start: Starts) -> None:
    die_at("waiting", place, f"wait={place.go}")
    record = next(
        file for file in map(json.loads, map(Path.read_text, place.logs.glob(".queue/*.json"))) if file["starts"]
    )
    os.killpg(record["starts"][0]["process"]["pid"], signal.SIGKILL)  # as when the machine goes down
    queue = start()
    place.go.touch()
    until(lambda: states(queue) == ["done", "done"])
    assert place.started()[record["id"]] == 2
    assert len(set(queue.submission(record["id"]).folders)) == 2  # type: ignore[union-attr]


def test_one_that_was_told_to_end_is_not_begun_again(place: Any, start: Starts) -> None:
    die_at("waiting", place, f"wait={place.go}")
    file = next(file for file in place.logs.glob(".queue/*.json") if json.loads(file.read_text())["starts"])
    content = json.loads(file.read_text())
    file.write_text(json.dumps(content | {"signals": 1}))
    os.killpg(content["starts"][0]["process"]["pid"], signal.SIGKILL)
    queue = start()
    assert queue.submission(content["id"]).state == "interrupted"  # type: ignore[union-attr]
    assert place.started()[content["id"]] == 1


def record_of(**changes: Any) -> SubmissionFile:
    content = {
        "id": "0" * 12,
        "overrides": ["experiment=quick"],
        "words": ["experiment=quick"],
        "directory": str(Path.cwd()),
        "logs": "/",
    }
    return SubmissionFile(**content | {"machine": recovery.process.machine_id(), "experiment": "quick"} | changes)


def test_what_brings_the_machine_down_is_not_begun_for_ever(tmp_path: Path) -> None:
    record = record_of(state="running", starts=[Attempt("quick/a", now())], logs=str(tmp_path))
    (tmp_path / "quick/a").mkdir(parents=True)
    states = []
    while record.state != "killed":
        states.append(record.state)
        record = recovery.taken_up(
            replace(record, state="running"), tmp_path, lambda _: False, lambda _: tmp_path / "x"
        )
    assert len(states) == 1 + recovery.MOST_RESTARTS
    assert "retry it by hand" in str(record.error)


@pytest.mark.parametrize("changes", [{"machine": "another"}, {"logs": "/copied/from"}, {"directory": "/elsewhere"}])
def test_logs_from_elsewhere_run_nothing_by_themselves(changes: dict[str, str], place: Any, start: Starts) -> None:
    (place.logs / ".queue").mkdir(parents=True)
    record_of(**{"logs": str(place.logs)} | changes).write(place.logs / ".queue")
    queue = start()
    (one,) = queue.submissions()
    assert one.state == "cancelled"
    assert "retry it" in str(one.error)
    queue.retry(one.id)
    until(lambda: states(queue) == ["done"])


def test_words_of_a_file_are_checked_again_before_they_are_run(place: Any, start: Starts) -> None:
    (place.logs / ".queue").mkdir(parents=True)
    record_of(logs=str(place.logs), words=["hydra.x=1"]).write(place.logs / ".queue")
    record_of(id="1" * 12, logs=str(place.logs), overrides=["refused=on"]).write(place.logs / ".queue")
    queue = start()
    until(lambda: sorted(states(queue)) == ["done", "failed"])
    assert queue.submission("1" * 12).error == "refused=on cannot be"  # type: ignore[union-attr]
    (line,) = place.lines()
    assert "hydra.x" not in line


def test_a_sweep_goes_on_where_it_is(tmp_path: Path) -> None:
    record = record_of(sweep=True, words=["-m", "seed=1,2"], starts=[Attempt("quick/s", now())])
    folder = tmp_path / "quick/s"
    common = ["-m", "seed=1,2", f"logs='{tmp_path}'"]
    assert commands.words_of(record, tmp_path) == [*common, f"hydra.sweep.dir='{folder}'"]
    folder.mkdir(parents=True)
    (folder / "jobs.jsonl").touch()
    assert commands.words_of(record, tmp_path) == [*common, f"resume={folder}"]
    again = replace(record, retry_failed=True)
    assert commands.words_of(again, tmp_path) == [*common, f"resume={folder}", "retry_failed=on"]


def test_a_number_that_another_process_got_is_not_taken_for_it(tmp_path: Path) -> None:
    here = run_queue.children.holder_of(os.getpid())
    assert here.process_start_ticks is not None
    assert lives(Attempt("a", now(), here), tmp_path / "none", "x")
    other = replace(here, process_start_ticks=here.process_start_ticks - 1)
    assert not lives(Attempt("a", now(), other), tmp_path / "none", "x")
    assert not lives(Attempt("a", now(), replace(here, boot_id="before")), tmp_path / "none", "x")


def test_a_second_service_is_refused_in_a_sentence(place: Any, start: Starts) -> None:
    start()
    with pytest.raises(DataError, match=r"another omnilab serve works on .*logs"):
        start()


@pytest.mark.parametrize(
    "text",
    ["", "{", "[]", "null", '{"id": 1}', "[" * 100_000],
)
def test_files_that_are_no_submissions_are_left_alone(
    text: str, place: Any, start: Starts, caplog: pytest.LogCaptureFixture
) -> None:
    (place.logs / ".queue").mkdir(parents=True)
    file = place.logs / ".queue" / f"{'a' * 12}.json"
    file.write_text(text)
    assert states(start()) == []
    assert file.read_text() == text
    assert "is left alone" in caplog.text


@pytest.mark.parametrize("change", [{"id": "../../etc"}, {"state": "running"}, {"priority": "1"}, {"words": [1]},
                                    {"priority": 10**30}, {"queued_s": 10**400}, {"signals": -5}, {"state": "<b>"},
                                    {"resumes": "/etc"}, {"jobs": True}, {"starts": [{}]},
                                    {"starts": [{"path": "../..", "time": now(), "process": None}]}])  # fmt: skip
def test_a_file_is_believed_only_if_all_of_it_can_be(
    change: dict[str, Any], place: Any, start: Starts, caplog: pytest.LogCaptureFixture
) -> None:
    (place.logs / ".queue").mkdir(parents=True)
    record_of(logs=str(place.logs)).write(place.logs / ".queue")
    file = place.logs / ".queue" / f"{'0' * 12}.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | change))
    assert states(start()) == []
    assert "cannot be read" in caplog.text


def test_the_oldest_of_very_many_that_ended_go(place: Any, start: Starts, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(submission_store, "MOST_ENDED", 2)
    folder = place.logs / ".queue"
    folder.mkdir(parents=True)
    for number in range(4):
        ended = f"2026-01-0{number + 1}T00:00:00+00:00"
        record_of(id=str(number) * 12, logs=str(place.logs), state="done", ended=ended).write(folder)
        (folder / f"{str(number) * 12}-1.log").touch()
    assert {one.id for one in start().submissions()} == {"2" * 12, "3" * 12}
    assert {file.stem.partition("-")[0] for file in folder.glob("[0-9]*")} == {"2" * 12, "3" * 12}
