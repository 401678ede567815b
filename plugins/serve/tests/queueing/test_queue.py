"""The queue: order, stopping, trying again, and what it refuses."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from queue_for_tests import until

from omnilab.client import SubmissionRequest
from omnilab.errors import ConfigError, DataError
from omnilab.runner.run_folder import find_runs
from omnilab.runner.run_folder.lock import RunLock
from omnilab_serve.queue import RunQueue, folder_state, interrupting, run_queue
from omnilab_serve.queue.submission_file import now

Starts = Callable[..., RunQueue]


def submit(queue: RunQueue, *overrides: str, priority: int = 0) -> str:
    return queue.submit(SubmissionRequest(["experiment=quick", *overrides], priority)).id


def state(queue: RunQueue, identity: str) -> str:
    found = queue.submission(identity)
    assert found is not None
    return found.state


def test_those_that_wait_are_begun_by_priority_and_age(place: Any, start: Starts) -> None:
    queue = start()
    first = submit(queue, f"wait={place.go}")
    until(lambda: state(queue, first) == "running")
    a, b, c, d = (submit(queue, priority=priority) for priority in (0, 0, 5, 0))
    queue.prioritise(b, 1)
    queue.prioritise(d, 7)
    queue.prioritise(d, 1)  # behind b, which has been there for longer
    assert [one.id for one in queue.waiting()] == [c, b, d, a]
    place.go.touch()
    until(lambda: all(one.state == "done" for one in queue.submissions()))
    assert [line.partition("-")[0] for line in place.lines()] == [first, c, b, d, a]
    assert [one.id for one in queue.submissions()] == [d, b, c, a, first]


def test_as_many_run_at_once_as_there_are_workers(place: Any, start: Starts) -> None:
    queue = start(workers=2)
    for _ in range(3):
        submit(queue, f"wait={place.go}")
    until(lambda: len(place.lines()) == 2)
    assert sorted(one.state for one in queue.submissions()) == ["queued", "running", "running"]
    place.go.touch()
    until(lambda: all(one.state == "done" for one in queue.submissions()))


def test_one_that_waits_is_taken_out_and_never_begun(place: Any, start: Starts) -> None:
    queue = start()
    first = submit(queue, f"wait={place.go}")
    until(place.lines)
    second, third = submit(queue), submit(queue)
    assert queue.cancel(second).state == "cancelled"
    with pytest.raises(DataError, match="nothing to cancel"):
        queue.cancel(second)
    place.go.touch()
    until(lambda: state(queue, third) == "done")
    assert set(place.started()) == {first, third}


def test_stopping_is_a_ctrl_c_at_first_and_a_kill_at_last(
    place: Any, start: Starts, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_queue, "PATIENCE_S", 0.0)
    queue = start()
    hears, deaf = submit(queue, "wait=never"), submit(queue, "wait=never", "deaf=on")
    until(lambda: queue.output(hears) == "it begins\n")
    queue.cancel(hears)
    until(lambda: state(queue, hears) == "interrupted")
    until(lambda: queue.output(deaf) == "it begins\n")
    assert [queue.cancel(deaf).stopping for _ in range(2)] == [1, 2]
    assert state(queue, deaf) == "running"
    queue.cancel(deaf)
    until(lambda: state(queue, deaf) == "killed")
    assert "SIGKILL" in str(queue.submission(deaf).error)  # type: ignore[union-attr]


def test_a_word_said_twice_at_once_is_one(place: Any, start: Starts) -> None:
    queue = start()
    deaf = submit(queue, "wait=never", "deaf=on")
    until(place.lines)
    assert [queue.cancel(deaf).stopping for _ in range(3)] == [1, 1, 1]


def test_one_that_failed_says_why_and_can_be_tried_again(place: Any, start: Starts) -> None:
    queue = start()
    identity = submit(queue, "ends=nothing")
    until(lambda: state(queue, identity) == "failed")
    assert queue.submission(identity).error == "that cannot be"  # type: ignore[union-attr]
    queue.retry(identity)
    with pytest.raises(DataError, match="only one that has ended"):
        queue.retry(identity)
    until(lambda: state(queue, identity) == "failed" and len(place.lines()) == 2)


def test_one_that_is_killed_is_not_begun_again_by_itself(place: Any, start: Starts) -> None:
    queue = start()
    identity = submit(queue, "wait=never")
    until(place.lines)
    holder = queue._records[identity].starts[-1].process
    assert holder is not None
    os.kill(holder.pid, signal.SIGKILL)
    until(lambda: state(queue, identity) == "killed")
    assert "memory" in str(queue.submission(identity).error)  # type: ignore[union-attr]


def test_a_folder_that_is_gone_is_said_to_be(
    place: Any, start: Starts, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    queue, work = start(), tmp_path / "work"
    work.mkdir()
    running = submit(queue, f"wait={place.go}")
    monkeypatch.chdir(work)
    identity = submit(queue)
    monkeypatch.chdir(tmp_path)
    work.rmdir()
    place.go.touch()
    until(lambda: state(queue, identity) == "failed")
    assert "work" in str(queue.submission(identity).error)  # type: ignore[union-attr]
    assert state(queue, running) == "done"


def test_what_cannot_be_is_refused_in_a_sentence(place: Any, start: Starts, monkeypatch: pytest.MonkeyPatch) -> None:
    queue = start()
    for request, sentence in (
        (SubmissionRequest(["experiment=quick", "refused=on"]), "refused=on cannot be"),
        (SubmissionRequest(["experiment=quick"], priority=10**9), "priority=1000000000 is out of range"),
    ):
        with pytest.raises(ConfigError, match=sentence):
            queue.submit(request)
    identity = submit(queue, f"wait={place.go}")
    until(place.lines)
    with pytest.raises(DataError, match="only what waits has a place"):
        queue.prioritise(identity, 3)
    monkeypatch.setattr(run_queue, "MOST_QUEUED", 2)
    submit(queue), submit(queue)
    with pytest.raises(ConfigError, match="2 submissions wait already"):
        submit(queue)


def test_the_folder_of_the_queue_is_no_run(place: Any, start: Starts) -> None:
    queue = start()
    identity = submit(queue)
    until(lambda: state(queue, identity) == "done")
    assert [run.folder.parent.name for run in find_runs(place.logs)] == ["quick"]
    assert not list(place.logs.glob(".queue/*.part"))


# ---------------------------------------------------------------------------------------- started elsewhere
SWEEP = {"command": ["-m", "experiment=quick", "seed=1,2"], "experiment": "quick", "jobs": 2, "launcher": "basic",
         "parameters": {"seed": ["1", "2"]}, "sweeper": "basic", "omnilab": "0", "time": "", "format": 1}  # fmt: skip


def sweep_of(place: Any, **changes: Any) -> Path:
    folder: Path = place.logs / "quick/sweep"
    folder.mkdir(parents=True)
    (folder / "jobs.jsonl").write_text('{"event": "planned", "job": 0, "overrides": ["seed=1"]}\n')
    (folder / "sweep.yaml").write_text(yaml.safe_dump({"directory": str(Path.cwd())} | SWEEP | changes))
    return folder


def test_a_sweep_of_elsewhere_goes_on_by_its_own_command(place: Any, start: Starts) -> None:
    sweep_of(place)
    queue = start()
    one = queue.resume("quick/sweep", retry_failed=True)
    assert (one.sweep, one.jobs, one.path, one.experiment) == (True, 2, "quick/sweep", "quick")
    until(place.lines)
    assert place.lines()[0].partition(" ")[2] == f"sweep resume {place.logs}/quick/sweep --retry-failed"
    until(lambda: state(queue, one.id) not in ("queued", "running"))


@pytest.mark.parametrize("word", ["hydra.callbacks.x._target_=os.system", "x=${oc.env:HOME}", "-cd=/tmp", "logs=/etc"])
def test_the_plan_of_a_stranger_is_not_run(word: str, place: Any, start: Starts) -> None:
    sweep_of(place, command=[*SWEEP["command"], word])  # type: ignore[misc]
    with pytest.raises(DataError, match=r"if that file is your own: omnilab sweep resume --trust"):
        start().resume("quick/sweep")
    assert place.lines() == []


def test_a_sweep_that_goes_on_is_left_alone(place: Any, start: Starts) -> None:
    folder = sweep_of(place)
    queue = start()
    with RunLock.take(folder), pytest.raises(DataError, match="is still running"):
        queue.resume("quick/sweep")


@pytest.mark.parametrize("path", ["..", "", ".", "/etc", "quick/../..", "nothing"])
def test_no_folder_outside_the_logs_is_touched(path: str, start: Starts) -> None:
    queue = start()
    for ask in (queue.resume, queue.interrupt):
        with pytest.raises(DataError, match="there is no folder"):
            ask(path)


HOLDS = """
import sys, time
from pathlib import Path
from omnilab.runner.run_folder.lock import RunLock
with RunLock.take(Path(sys.argv[1])):
    print("taken", flush=True)
    time.sleep(60)
"""


def test_what_was_started_elsewhere_is_interrupted_if_it_surely_is_that(place: Any, start: Starts) -> None:
    folder = place.logs / "grid/run"
    folder.mkdir(parents=True)
    queue = start()
    with pytest.raises(DataError, match="does not run"):
        queue.interrupt("grid/run")
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLDS, str(folder)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert holder.stdout is not None
    holder.stdout.readline()
    copy = place.logs / "grid/copy"  # whose lock names the same process, which does not hold it
    copy.mkdir()
    (copy / "run.lock").write_text((folder / "run.lock").read_text().replace('"flock": true', '"flock": false'))
    with pytest.raises(DataError, match="nothing was stopped"):
        queue.interrupt("grid/copy")
    assert holder.poll() is None
    queue.interrupt("grid/run")
    _, errors = holder.communicate(timeout=30)
    assert b"KeyboardInterrupt" in errors


def test_the_service_does_not_stop_itself_nor_one_job_of_a_sweep(place: Any, start: Starts) -> None:
    queue = start()
    with pytest.raises(DataError, match="does not run"):
        queue.interrupt(".queue")
    job = sweep_of(place) / "0"
    job.mkdir()
    with RunLock.take(job), pytest.raises(DataError, match="job of a sweep"):
        queue.interrupt("quick/sweep/0")
    with RunLock.take(place.logs / "quick"), pytest.raises(DataError, match="nothing was stopped"):
        interrupting.interrupt_holder(place.logs / "quick", "quick")  # this process itself


# ---------------------------------------------------------------------------------------- how it ended
@pytest.mark.parametrize(
    ("status", "code", "signals", "expected"),
    [
        ({"status": "done"}, 0, 0, ("done", None)),
        ({"status": "failed", "error": "too small"}, 1, 0, ("failed", "too small")),
        ({"status": "failed", "error": {"not": "a text"}}, 1, 0, ("failed", None)),
        ({"status": "interrupted"}, 130, 1, ("interrupted", None)),
        (
            {"status": "running"},
            -9,
            0,
            ("killed", "its process was ended by SIGKILL; the system does so where memory is too little"),
        ),
        ({"status": "running"}, -9, 3, ("killed", "its process was ended by SIGKILL")),
        ({"status": "running"}, None, 0, ("killed", "its process was ended from outside")),
        ({"status": "weird"}, 0, 0, ("killed", "its process was ended from outside")),
        (None, 130, 1, ("interrupted", None)),
        (None, 2, 0, ("failed", "the last line")),
        (None, None, 1, ("interrupted", None)),
    ],
)
def test_how_it_ended_is_what_its_folder_says_or_its_process(
    status: dict[str, Any] | None, code: int | None, signals: int, expected: tuple[str, str], tmp_path: Path
) -> None:
    if status:
        rest = {"time": "2026-01-01T00:00:00+00:00", "pid": 2**22 + 1}
        (tmp_path / "status.json").write_text(json.dumps(rest | status))
    found = folder_state.state_of(tmp_path, sweep=False, since=now())
    how = folder_state.ended_state(found, code, signals, "a line\nomnilab: the last line\n")
    assert (how.state, how.error) == expected
