"""The lock of a run folder, and what it says of the run: running, silent, killed."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from omnilab.errors import DataError
from omnilab.runner.run_folder import RunFolder, load_run
from omnilab.runner.run_folder.lock import FRESH_S, LOCK, REPAIR, RunLock

MANIFEST = {"experiment": "grid", "overrides": []}
WRITER = """
import sys, time
from pathlib import Path
from omnilab.runner.run_folder import RunFolder
RunFolder(Path(sys.argv[1])).open({"experiment": "grid", "overrides": []}, "study: {}")
print("open", flush=True)
time.sleep(600)
"""
IN_NAMESPACE = ["unshare", "--pid", "--fork", "--kill-child", "--mount-proc"]


def writer(folder: Path, *prefix: str) -> subprocess.Popen[str]:
    """A process that writes a run, which has begun."""
    process = subprocess.Popen([*prefix, sys.executable, "-c", WRITER, folder], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "open\n"
    return process


def killed(folder: Path, *prefix: str) -> None:
    """Leave a run whose process was killed."""
    with writer(folder, *prefix) as process:
        process.kill()


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "run"


@pytest.fixture
def namespace():
    if subprocess.run([*IN_NAMESPACE, "true"], capture_output=True, check=False).returncode:
        pytest.skip("PID namespaces are not permitted here")
    return IN_NAMESPACE


def edit(folder: Path, age_s: float = 0.0, **changes: object) -> None:
    """As another host would have written the lock, so long ago."""
    file = folder / LOCK
    file.write_text(json.dumps(json.loads(file.read_text()) | changes))
    os.utime(file, (time.time() - age_s,) * 2)


# ------------------------------------------------------------------------------------------------------- on this host
def test_a_run_is_running_until_its_process_is_killed(folder):
    with writer(folder) as process:
        run = load_run(folder)
        assert (run.state, run.alive) == ("running", True)
        assert f"(process {process.pid}), on host {os.uname().nodename}, last heartbeat" in run.lock.words
        process.kill()
    assert (run.state, run.alive) == ("killed", False)


def test_a_stopped_run_is_running(folder):
    with writer(folder) as process:
        process.send_signal(signal.SIGSTOP)
        os.utime(folder / LOCK, (0, 0))
        assert load_run(folder).state == "running"
        process.kill()


def test_a_run_in_another_pid_namespace_is_running_and_killed_like_any_other(folder, namespace):
    with writer(folder, *namespace) as process:
        assert json.loads((folder / "status.json").read_text())["pid"] < 10
        assert load_run(folder).state == "running"
        process.kill()  # unshare, and by --kill-child the run
        process.wait()
        wait_for(lambda: load_run(folder).state == "killed")


def wait_for(condition) -> None:
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def test_the_process_number_of_a_killed_run_may_be_anothers(folder):
    killed(folder)
    edit(folder, pid=os.getpid())
    assert load_run(folder).state == "killed"


def test_a_run_that_ends_while_it_is_looked_at_was_not_killed(folder):
    run_folder = RunFolder(folder)
    run_folder.open(MANIFEST, "study: {}")
    run = load_run(folder)
    assert run.status["status"] == "running"
    run_folder.status("done")
    run_folder.close()
    assert run.state == "done"


def test_a_child_that_outlives_the_run_does_not_hold_its_lock(folder):
    forking = WRITER.replace("time.sleep", "import os; os.fork(); time.sleep")
    with subprocess.Popen(
        [sys.executable, "-c", forking, folder], stdout=subprocess.PIPE, start_new_session=True
    ) as one:
        assert one.stdout is not None
        one.stdout.readline()
        time.sleep(0.5)  # until it has forked
        os.kill(one.pid, signal.SIGKILL)
        wait_for(lambda: load_run(folder).state == "killed")
        os.killpg(one.pid, signal.SIGKILL)


def test_the_heartbeat_ends_with_the_run(folder, monkeypatch):
    monkeypatch.setattr("omnilab.runner.run_folder.lock.HEARTBEAT_S", 0.01)
    before = threading.active_count()
    run = RunFolder(folder)
    run.open(MANIFEST, "")
    os.utime(folder / LOCK, (0, 0))
    wait_for(lambda: (folder / LOCK).stat().st_mtime > 0)
    run.close()
    assert threading.active_count() == before
    os.utime(folder / LOCK, (0, 0))
    time.sleep(0.1)
    assert (folder / LOCK).stat().st_mtime == 0


def test_a_run_whose_logs_were_mended_under_it_is_told(folder, monkeypatch, caplog):
    monkeypatch.setattr("omnilab.runner.run_folder.lock.HEARTBEAT_S", 0.01)
    run = RunFolder(folder)
    run.open(MANIFEST, "")
    edit(folder, purpose=REPAIR)  # as from a host that sees no lock of this one
    wait_for(lambda: "the logs of this run were mended from elsewhere" in caplog.text)
    run.close()


# ------------------------------------------------------------------------------------------------------- on another
@pytest.mark.parametrize(
    ("age_s", "state"), [(0, "running"), (FRESH_S / 2, "running"), (2 * FRESH_S, "silent"), (-3600, "silent")]
)
def test_a_run_of_another_host_runs_while_its_heart_beats(folder, age_s, state):
    killed(folder)
    edit(folder, age_s, host="elsewhere", boot_id="another")
    run = load_run(folder)
    assert (run.state, run.alive) == (state, True)
    assert ", on host elsewhere, last heartbeat" in run.lock.words


@pytest.mark.parametrize(("host", "state"), [(None, "killed"), ("elsewhere", "silent")])
def test_a_run_from_before_this_host_was_started_anew_was_killed(folder, host, state):
    killed(folder)
    edit(folder, age_s=time.time() - 1e9, boot_id="before", **({"host": host} if host else {}))
    if json.loads((folder / LOCK).read_text())["machine"] is None:
        state = "silent"  # nothing says that it is the same machine
    assert load_run(folder).state == state


@pytest.mark.parametrize(("alive", "state"), [(True, "running"), (False, "killed")])
def test_where_the_disk_cannot_lock_the_process_is_looked_for(folder, alive, state):
    killed(folder)
    run = RunFolder(folder.parent / "own")
    run.open(MANIFEST, "")
    run.close()
    start = json.loads((folder.parent / "own" / LOCK).read_text())["process_start_ticks"]
    edit(folder, 3600, flock=False, pid=os.getpid(), process_start_ticks=start if alive else start - 1)
    assert load_run(folder).state == state


def test_a_disk_that_cannot_lock_is_noted_and_a_second_run_refused_by_the_heartbeat(folder, monkeypatch):
    def no_locks(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("fcntl.flock", no_locks)
    run = RunFolder(folder)
    run.open(MANIFEST, "")
    assert (
        "this disk cannot lock run.lock: whether the run lives is told by its heartbeat"
        in (folder / "run.log").read_text()
    )
    assert load_run(folder).state == "running"
    with pytest.raises(DataError, match="is still running"):
        RunLock.take(folder, REPAIR, ended=True)
    run.close()
    edit(folder, boot_id="another", host="elsewhere")
    assert load_run(folder).state == "running"
    edit(folder, 2 * FRESH_S)
    assert load_run(folder).state == "silent"


@pytest.mark.parametrize("text", ["", "[]", "{}", "{" * 5000, '{"pid": 1}', "\0" * 900])
def test_of_a_damaged_lock_the_heartbeat_counts(folder, text):
    killed(folder)
    (folder / LOCK).write_text(text)
    assert load_run(folder).state == "running"
    os.utime(folder / LOCK, (0, 0))
    assert load_run(folder).state == "silent"


@pytest.mark.parametrize("kind", ["fifo", "folder", "link"])
def test_what_is_no_lock_file_is_neither_read_nor_written(folder, kind):
    precious = folder.parent / "precious"
    precious.write_text("mine")
    killed(folder)
    file = folder / LOCK
    file.unlink()
    {"fifo": lambda: os.mkfifo(file), "folder": file.mkdir, "link": lambda: file.symlink_to(precious)}[kind]()
    assert load_run(folder).alive
    with pytest.raises(DataError, match=r"run\.lock cannot be written"):
        RunLock.take(folder, REPAIR, ended=True)
    assert precious.read_text() == "mine"


# ------------------------------------------------------------------------------------------------------- of before
def unlocked(folder: Path, **status: object) -> Path:
    """A run of before there were locks."""
    folder.mkdir()
    (folder / "status.json").write_text(json.dumps({"status": "running", **status}))
    return folder


def test_a_run_of_before_was_killed_if_its_process_is_not_there_or_younger_or_another_program(folder, tmp_path):
    assert load_run(unlocked(tmp_path / "none", pid=2**22 + 1)).state == "killed"
    with subprocess.Popen(["sleep", "600"]) as other:
        assert load_run(unlocked(tmp_path / "other", pid=other.pid)).state == "killed"
        other.kill()
    if sys.platform == "linux":
        assert load_run(unlocked(folder, pid=os.getpid(), time="2020-01-01T00:00:00+00:00")).state == "killed"


def test_a_run_of_before_runs_while_it_writes(folder):
    run = load_run(unlocked(folder, pid=os.getpid()))
    assert run.state == "running"
    os.utime(folder / "status.json", (0, 0))
    assert run.state == "silent"
    (folder / "run.log").write_text("a line")
    assert run.state == "running"


def test_a_run_of_before_on_another_host_is_never_killed(folder):
    run = load_run(unlocked(folder, pid=2**22 + 1))
    (folder / "manifest.json").write_text(json.dumps(MANIFEST | {"host": {"name": "elsewhere"}}))
    assert run.state == "running"
    os.utime(folder / "status.json", (0, 0))
    assert run.state == "silent"


# ------------------------------------------------------------------------------------------------------- a folder each
def test_a_second_run_into_a_folder_is_refused(folder):
    with writer(folder) as process:
        before = {file.name: file.read_bytes() for file in folder.iterdir()}
        with pytest.raises(
            DataError, match=r"holds a run already, which a new run might replace; give another hydra\.run\.dir"
        ):
            RunFolder(folder).open(MANIFEST, "other: {}")
        assert before == {file.name: file.read_bytes() for file in folder.iterdir()}
        process.kill()
    with pytest.raises(DataError, match="holds a run already"):
        RunFolder(folder).open(MANIFEST, "other: {}")


def test_a_folder_is_refused_to_the_second_of_two_that_begin(folder):
    folder.mkdir()
    with RunLock.take(folder), pytest.raises(DataError, match=r"is still running \(process \d+\), on host "):
        RunFolder(folder).open(MANIFEST, "")


@pytest.mark.parametrize("name", ["config.yaml", "queries.csv", "run.log"])
def test_files_that_a_run_might_replace_are_not(folder, name):
    folder.mkdir()
    (folder / name).write_text("mine")
    with pytest.raises(DataError, match=f"holds the file {name} already, which a new run might replace"):
        RunFolder(folder).open(MANIFEST, "")
    assert [(file.name, file.read_text()) for file in folder.iterdir()] == [(name, "mine")]


def test_what_hydra_and_a_killed_start_left_is_in_nobodys_way(folder):
    killed(folder)
    (folder / "status.json").unlink()
    (folder / ".hydra").mkdir()
    (folder / "omnilab.log").touch()
    run = RunFolder(folder)
    run.open(MANIFEST, "")
    run.close()


def test_a_reader_keeps_nobody_from_a_lock(folder):
    killed(folder)
    (folder / "status.json").unlink()
    stop = threading.Event()
    run = load_run(unlocked(folder.parent / "other", pid=1))
    object.__setattr__(run, "folder", folder)

    def read() -> None:
        while not stop.is_set():
            _ = run.lock
            time.sleep(0.0005)

    readers = [threading.Thread(target=read) for _ in range(2)]
    for reader in readers:
        reader.start()
    try:
        for _ in range(50):
            RunLock.take(folder, REPAIR).release()
    finally:
        stop.set()
        for reader in readers:
            reader.join()


# ------------------------------------------------------------------------------------------------------- sweeps
PING = """
from dataclasses import dataclass
from omnilab import Metric, Report, hookimpl

@dataclass
class Ping:
    answer: float = 1.0
    needs = ()
    def run(self, parts, record, rng):
        return Report([Metric("answer", self.answer, "1")])

@hookimpl
def register_studies(register):
    register("ping", Ping)
"""
SWEEP = "-m", "~experiment", "study=ping", "~sinks.rerun", "~sinks.mcap", "hydra.sweep.dir=logs/s"


def test_a_second_sweep_into_a_folder_runs_no_job(omnilab_here, tmp_path, monkeypatch):
    (tmp_path / "ping.py").write_text(PING)
    monkeypatch.setenv("OMNILAB_PLUGINS", "ping.py")
    first = omnilab_here(*SWEEP, "study.answer=1,2")
    assert first.rc == 0, first.stderr
    before = {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}
    second = omnilab_here(*SWEEP, "study.answer=3,4,5")
    assert (second.rc, second.stdout) == (2, "")
    assert second.stderr == (
        "omnilab: logs/s holds a sweep already; go on with it (omnilab sweep resume logs/s), or give another"
        " hydra.sweep.dir\n"
    )
    assert before == {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}


@pytest.mark.slow
def test_a_sweep_into_a_folder_where_another_goes_on_is_told(omnilab_here, tmp_path, monkeypatch):
    (tmp_path / "ping.py").write_text(PING)
    monkeypatch.setenv("OMNILAB_PLUGINS", "ping.py")
    (tmp_path / "logs" / "s").mkdir(parents=True)
    with RunLock.take(tmp_path / "logs" / "s"):
        second = omnilab_here(*SWEEP, "study.answer=3,4,5")
    assert (second.rc, second.stdout) == (2, "")
    assert "omnilab: logs/s is still running (process " in second.stderr
    assert "give another hydra.run.dir (of a sweep: hydra.sweep.dir)\n" in second.stderr
    assert omnilab_here(*SWEEP, "study.answer=3,4,5").rc == 0
