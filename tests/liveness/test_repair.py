"""Repairing and showing runs: only what is surely over is touched, of all else a copy is mended."""

from __future__ import annotations

import csv
import gc
import json
import os
import subprocess
import sys
import threading
import time
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import pytest
from mcap.reader import make_reader

from omnilab.api import Text, Tick
from omnilab.errors import DataError
from omnilab.runner import repair
from omnilab.runner.repair import RunsOnDisk, mend, mend_copy
from omnilab.runner.run_folder import DONE, RunFolder, load_run
from omnilab.runner.run_folder.lock import LOCK
from omnilab.runner.run_folder.names import RESERVED
from omnilab_mcap import McapSink
from omnilab_rerun import RerunSink

SCRIPT = Path(sys.executable).with_name("omnilab")
WORLD = Path(__file__).parents[1] / "box_world.yaml"


class Sinks:
    """A registry of one sink, whose repair adds a line to a log."""

    def __init__(self, action=lambda folder: None):
        self.action = action
        self.repaired: list[Path] = []

    def names(self, kind):
        return ["first", "second"]

    def get(self, kind, name):
        return SimpleNamespace(cls=lambda: SimpleNamespace(repair=lambda folder: self._repair(name, folder)))

    def _repair(self, name, folder):
        if name == "first":
            self.action(folder)
            return None
        self.repaired.append(folder)
        with (folder / "run.second").open("a") as log:
            log.write("mended\n")
        return "run.second was torn"


def made(folder: Path, manifest_host: str = "") -> RunFolder:
    """A run that has begun."""
    run = RunFolder(folder)
    run.open({"experiment": "grid", "overrides": [], "host": {"name": manifest_host}}, "study: {}")
    (folder / "run.second").write_text("torn\n")
    return run


@pytest.fixture
def live(tmp_path):
    run = made(tmp_path / "logs" / "live")
    yield run.folder
    run.close()


@pytest.fixture
def killed(tmp_path):
    run = made(tmp_path / "logs" / "killed")
    run.close()  # without a last status: as if its process were gone
    return run.folder


@pytest.fixture
def silent(killed):
    lock = killed / LOCK
    lock.write_text(json.dumps(json.loads(lock.read_text()) | {"host": "elsewhere", "boot_id": "another"}))
    os.utime(lock, (time.time() - 3600,) * 2)
    return killed


def contents(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir() if file.is_file() and not file.is_symlink()}


# ------------------------------------------------------------------------------------------------------- repair
def test_a_killed_run_is_mended_and_says_so(killed):
    assert load_run(killed).state == "killed"
    assert mend(load_run(killed), Sinks()) == ["run.second was torn"]
    assert (killed / "run.second").read_text() == "torn\nmended\n"
    assert load_run(killed).status["status"] == "killed"


def test_a_run_that_goes_on_is_left_alone(live):
    before = contents(live)
    with pytest.raises(DataError, match=r"still running \(process \d+\), on host .*; wait for it, or end it first"):
        mend(load_run(live), sinks := Sinks(), ended=True)
    assert (contents(live), sinks.repaired) == (before, [])


def test_a_silent_run_is_mended_only_if_its_user_knows_that_it_ended(silent, omnilab_here):
    before = contents(silent)
    result = omnilab_here("repair", str(silent))
    assert result.rc == 2
    assert "logs/killed may still be running, which cannot be told from here" in result.stderr
    assert ", on host elsewhere, last heartbeat 60 min ago; look there, and if it has ended: " in result.stderr
    assert contents(silent) == before
    assert " silent " in omnilab_here("runs").stdout
    command = result.stderr.strip().rpartition(": omnilab ")[2].split()
    assert omnilab_here(*command).rc == 0
    assert load_run(silent).status["status"] == "killed"


def test_a_run_that_ends_before_the_repair_begins_stays_as_it_says(tmp_path):
    writing = made(tmp_path / "run")
    run = load_run(tmp_path / "run")
    assert run.status["status"] == "running"
    writing.status(DONE)
    writing.close()
    mend(run, Sinks())
    assert load_run(run.folder).status["status"] == DONE


def test_of_two_repairs_one_is_told(killed):
    begun, go_on = threading.Event(), threading.Event()

    def wait(folder):
        begun.set()
        assert go_on.wait(60)

    first = threading.Thread(target=mend, args=(load_run(killed), sinks := Sinks(wait)))
    first.start()
    try:
        assert begun.wait(60)
        assert load_run(killed).state == "killed"
        with pytest.raises(DataError, match=r"still being repaired \(process \d+\), on host .*; wait for it"):
            mend(load_run(killed), second := Sinks())
    finally:
        go_on.set()
        first.join()
    assert (sinks.repaired, second.repaired) == ([killed], [])
    mend(load_run(killed), Sinks())


@pytest.mark.parametrize("error", [DataError("run.first is no log"), PermissionError(13, "Permission denied")])
def test_a_sink_that_cannot_mend_keeps_no_other_from_it(killed, error, capsys):
    def fail(folder):
        raise error

    with pytest.raises(
        DataError, match=r"run\.first is no log|sink 'first' in .* \(Permission denied\); a mended copy: "
    ):
        mend(load_run(killed), sinks := Sinks(fail))
    assert capsys.readouterr().err == "omnilab: run.second was torn\n"
    assert sinks.repaired == [killed]
    assert load_run(killed).status["status"] == "killed"


@pytest.mark.parametrize("error", [ValueError("no such byte"), SystemExit(0)])
def test_a_sink_that_fails_keeps_no_other_from_it_and_shows_where(killed, error, capsys):
    def fail(folder):
        raise error

    with pytest.raises(DataError, match=r"sink 'first' failed to mend its files in .*, which is a bug of its plugin"):
        mend(load_run(killed), sinks := Sinks(fail))
    printed = capsys.readouterr().err
    assert "Traceback" in printed
    assert printed.endswith("omnilab: run.second was torn\n")
    assert sinks.repaired == [killed]


def test_damaged_logs_of_a_run_that_ended_well_are_found(tmp_path, omnilab_here):
    run = made(tmp_path / "logs" / "run")
    for sink in McapSink(), RerunSink():
        sink.open(run.folder)
        for step in range(20):
            sink.write("log", Text(f"step {step}"), Tick(step, step))
            sink.flush()
        sink.close()
    run.status(DONE)
    run.close()
    assert "is whole, nothing to repair" in omnilab_here("repair", "logs/run").stderr
    mcap, rrd = run.folder / "run.mcap", run.folder / "run.rrd"
    log, recording = mcap.read_bytes(), rrd.read_bytes()
    at = log.index(b"\x04\0\0\0zstd", len(log) // 3)  # within the head of a chunk
    mcap.write_bytes(log[: at + 30] + bytes([log[at + 30] ^ 1]) + log[at + 31 :])
    rrd.write_bytes(recording[: len(recording) // 2] + bytes(len(recording) // 2))
    result = omnilab_here("repair", "logs/run")
    assert result.rc == 0, result.stderr
    assert "19 messages were kept and indexed again, 1 was lost, logged from 20" in result.stderr
    assert "run.rrd had no whole footer and was written anew" in result.stderr
    assert "is whole, nothing to repair" in omnilab_here("repair", "logs/run").stderr
    assert load_run(run.folder).status["status"] == DONE


# ------------------------------------------------------------------------------------------------------- copies
def test_a_mended_copy_leaves_the_run_as_it_is(live, tmp_path):
    os.mkfifo(live / "pipe")
    (live / "link").symlink_to("/etc/passwd")
    (live / "views").mkdir()
    (live / "views" / "0.png").write_bytes(b"picture")
    (live / "views").chmod(0o555)
    (live / "run.second").chmod(0o444)
    before = contents(live)
    assert mend_copy(load_run(live), tmp_path / "a" / "copy", Sinks()) == ["run.second was torn"]
    assert contents(live) == before
    copy = tmp_path / "a" / "copy"
    assert {path.name for path in copy.rglob("*")} == {*before, "views", "0.png"} - {LOCK, RESERVED}
    assert (copy / "run.second").read_text() == "torn\nmended\n"
    assert load_run(copy).state == "killed"
    assert (copy / "views").stat().st_mode & 0o200, "what a copy lets nobody do is not to be mended"
    assert load_run(live).state == "running"


@pytest.mark.parametrize("where", ["logs", "logs/live/copy"])
def test_a_copy_goes_into_a_folder_of_its_own(live, tmp_path, where):
    with pytest.raises(DataError, match="is there already, or lies in the run's folder"):
        mend_copy(load_run(live), tmp_path / where, Sinks())


def test_a_copy_that_fails_leaves_nothing(live, tmp_path, monkeypatch):
    def full(source, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(repair, "_copy_file", full)
    with pytest.raises(
        DataError, match=r"cannot be copied to .*copy \(.*No space left on device\); give another folder"
    ):
        mend_copy(load_run(live), tmp_path / "copy", Sinks())
    assert [path.name for path in tmp_path.iterdir()] == ["logs"]


def test_a_copy_that_finds_no_room_is_not_begun(live, tmp_path, monkeypatch):
    monkeypatch.setattr(repair.shutil, "disk_usage", lambda _: SimpleNamespace(free=10))
    with pytest.raises(DataError, match=r"has room for 0; set TMPDIR, or --output of omnilab repair, to a folder with"):
        mend_copy(load_run(live), tmp_path / "copy", Sinks())


def test_what_a_live_run_renames_while_it_is_copied_is_no_error(live, tmp_path, monkeypatch):
    copy_file = repair._copy_file

    def copy_late(source, target):
        if source.suffix == ".part":
            source.unlink()
        copy_file(source, target)

    monkeypatch.setattr(repair, "_copy_file", copy_late)
    (live / "queries.csv.part").touch()
    mend_copy(load_run(live), tmp_path / "copy", Sinks())
    assert "queries.csv.part" not in contents(tmp_path / "copy")


@pytest.mark.parametrize("state", ["live", "silent"])
def test_what_is_shown_of_a_run_that_may_go_on_is_a_copy_that_goes_away(state, request, capsys):
    folder = request.getfixturevalue(state)
    before = contents(folder)
    runs = RunsOnDisk(Sinks())
    copy = runs.ready(folder)
    assert copy != folder
    assert (copy / "run.second").read_text() == "torn\nmended\n"
    assert contents(folder) == before
    (line,) = capsys.readouterr().err.splitlines()
    assert "still" in line
    assert line.endswith(" ago; a copy of what is there is shown")
    del runs
    gc.collect()
    assert not copy.exists()


def test_what_is_shown_of_a_killed_run_is_the_run_mended(killed, capsys):
    assert RunsOnDisk(Sinks()).ready(killed) == killed
    assert load_run(killed).status["status"] == "killed"
    assert capsys.readouterr().err == "omnilab: run.second was torn\n"


# ------------------------------------------------------------------------------------------------------- read-only
@pytest.fixture
def read_only(tmp_path):
    """`read_only(folder)`: what to put before a command for which the folder lies on a disk that it cannot write."""

    def prefix(folder: Path) -> list[str]:
        if os.geteuid():
            folder.chmod(0o555)
            for file in folder.iterdir():
                file.chmod(0o444)
            return []
        script = 'mount --bind "$0" "$0" && mount -o remount,bind,ro "$0" && exec "$@"'
        command = ["unshare", "--mount", "sh", "-c", script, str(folder)]
        if subprocess.run([*command, "true"], capture_output=True, check=False).returncode:
            pytest.skip("nothing can be mounted here, and the superuser writes everywhere")
        return command

    yield prefix
    for folder in tmp_path.glob("logs/*"):
        folder.chmod(0o755)


def test_a_run_on_a_disk_that_cannot_be_written_is_mended_elsewhere(killed, tmp_path, read_only):
    prefix, before = read_only(killed), contents(killed)

    def omnilab(*arguments):
        call = [*prefix, SCRIPT, *arguments]
        done = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True, timeout=240, check=False)
        return done.returncode, done.stderr

    assert (
        " killed "
        in subprocess.run(
            [*prefix, SCRIPT, "runs"], cwd=tmp_path, capture_output=True, text=True, timeout=240, check=False
        ).stdout
    )
    rc, refused = omnilab("repair", "logs/killed")
    assert rc == 2
    assert f"{LOCK} cannot be written (" in refused
    assert "; a mended copy: omnilab repair " in refused
    rc, mended = omnilab(*refused.strip().rpartition(": omnilab ")[2].replace("DIR", "copy").split())
    assert (rc, mended) == (0, "omnilab: the mended copy is copy\n")
    assert contents(killed) == before
    assert load_run(tmp_path / "copy").state == "killed"


def test_a_whole_run_on_such_a_disk_needs_nothing(killed, tmp_path, read_only):
    RunFolder(killed).status(DONE)
    prefix = read_only(killed)
    call = [*prefix, SCRIPT, "repair", "logs/killed"]
    done = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True, timeout=240, check=False)
    assert (done.returncode, done.stderr) == (0, "omnilab: logs/killed is whole, nothing to repair\n")


# ------------------------------------------------------------------------------------------------------- whole runs
@pytest.mark.slow
def test_repairs_and_views_of_a_live_run_in_a_container_cost_it_nothing(tmp_path, omnilab_in):
    """They found it killed, replaced its logs, and what it wrote later was lost."""
    namespace = ["unshare", "--pid", "--fork", "--kill-child", "--mount-proc"]
    if subprocess.run([*namespace, "true"], capture_output=True, check=False).returncode:
        pytest.skip("PID namespaces are not permitted here")
    shell = "(echo 900000 > /proc/sys/kernel/ns_last_pid) 2> /dev/null; exec"
    small = "sensor.size=64 sensor.samples=1 descriptor.offsets=32 descriptor.angles=60 study.step_m=0.4 cache=off"
    study = "experiment=quickstart study.query_count=2000 study.show=500"
    (tmp_path / "copies").mkdir()
    call = f"{shell} {SCRIPT} {study} sensor.world={WORLD} {small} hydra.run.dir=logs/run"
    with subprocess.Popen([*namespace, "sh", "-c", call], cwd=tmp_path, stderr=subprocess.PIPE, text=True) as run:
        folder, refused = tmp_path / "logs" / "run", 0
        while run.poll() is None:
            if (folder / "run.mcap").exists():
                result = omnilab_in(tmp_path, "repair", "logs/run")
                refused += "still running (process " in result.stderr
                view = "view", "logs/run", "--screenshot", "picture.txt"  # which goes up to the name of the file
                omnilab_in(tmp_path, *view, env={"TMPDIR": str(tmp_path / "copies")})
            time.sleep(0.5)
        assert run.wait() == 0, run.stderr and run.stderr.read()
    assert refused > 0
    assert json.loads((folder / "status.json").read_text())["sinks_dropped"] == {}
    with (folder / "queries.csv").open() as table:
        assert len(list(csv.DictReader(table))) == 2000
    with (folder / "run.mcap").open("rb") as log:
        topics = Counter(channel.topic for _, channel, _ in make_reader(log).iter_messages())
    assert topics["/error/position_m"] == 2000
    assert not list((tmp_path / "copies").iterdir())
