"""Sinks that fail while a run goes on, are left out, or serve it live."""

from __future__ import annotations

import re
import resource
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.reader import make_reader
from rerun.chunk import RrdReader

from omnilab.runner.run_folder import LoadedRun, load_run
from omnilab_rerun.sink import RerunSink

WORLD = Path(__file__).parents[1] / "box_world.yaml"
SMALL = [
    "experiment=quickstart", f"sensor.world={WORLD}", "sensor.size=64", "sensor.samples=1", "descriptor.offsets=32",
    "descriptor.angles=60", "study.step_m=1.5", "study.query_count=8", "study.show=4",
]  # fmt: skip
RERUN_FULL = "takes no more records|Failed to write"  # as it is found at the next flush, or at the next record
DISK_FULL = '''
"""A sink whose disk is full after a few records."""
import errno, os
from dataclasses import dataclass
from omnilab import hookimpl

@dataclass
class Full:
    """Takes some records, then none."""
    room: int = 5  # records
    fails: str = "write"  # in which method

    def open(self, folder): self.check("open")
    def write(self, path, record, tick):
        self.room -= 1
        if self.room < 0: self.check("write")
    def flush(self): self.check("flush")
    def close(self): self.check("close")
    def repair(self, folder): return None
    def check(self, method):
        if method == self.fails:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "full.log")

@hookimpl
def register_sinks(register):
    register("full", Full)
'''


def check_dropped(run: LoadedRun, stderr: str, name: str, cause: str) -> None:
    """The run ended well, and it is told in three places which sink it lost, and why (`cause` is a pattern)."""
    assert run.state == "done"
    assert list(run.status["sinks_dropped"]) == [name]
    assert re.search(cause, run.status["sinks_dropped"][name])
    assert run.metrics["queries"] == 8
    for place in (stderr, (run.folder / "run.log").read_text()):
        (line,) = [line for line in place.splitlines() if f"sink '{name}'" in line and "the run goes on" in line]
        assert re.search(cause, line)


def check_mcap(run: LoadedRun) -> None:
    with (run.folder / "run.mcap").open("rb") as stream:
        assert make_reader(stream, validate_crcs=True).get_summary().statistics.message_count > 20


def check_rrd(run: LoadedRun) -> None:
    assert len(list(RrdReader(run.folder / "run.rrd").stream().to_chunks())) > 10


@pytest.mark.parametrize(
    "method", ["write", *(pytest.param(m, marks=pytest.mark.slow) for m in ("open", "flush", "close"))]
)
def test_a_full_disk_costs_one_sink_and_no_more(omnilab_here, tmp_path, monkeypatch, method):
    (tmp_path / "full.py").write_text(DISK_FULL)
    monkeypatch.setenv("OMNILAB_PLUGINS", "full.py")
    monkeypatch.setattr("omnilab.runner.recorder.outputs.FLUSH_S", 0.05)
    result = omnilab_here(*SMALL, "+sink@sinks.full=full", f"sinks.full.fails={method}")
    assert result.rc == 0, result.stderr
    assert "Traceback" not in result.stderr
    run = load_run(tmp_path / "logs" / "latest")
    check_dropped(run, result.stderr, "full", "No space left on device")
    check_mcap(run)
    check_rrd(run)


@pytest.mark.parametrize(
    ("name", "file"), [("rerun", "run.rrd"), pytest.param("mcap", "run.mcap", marks=pytest.mark.slow)]
)
def test_a_path_that_cannot_be_written_costs_one_sink(omnilab_here, tmp_path, name, file):
    """A folder lies where the file should go."""
    folder = tmp_path / "given"
    (folder / file).mkdir(parents=True)
    result = omnilab_here(*SMALL, f"hydra.run.dir={folder}")
    assert result.rc == 0, result.stderr
    run = load_run(folder)
    check_dropped(run, result.stderr, name, file)
    check_rrd(run) if name == "mcap" else check_mcap(run)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a disk that is always full")
def test_rerun_on_a_full_disk(omnilab_here, tmp_path, monkeypatch):
    opened = RerunSink.open

    def on_a_full_disk(self, folder):
        (folder / "run.rrd").symlink_to("/dev/full")
        opened(self, folder)

    monkeypatch.setattr(RerunSink, "open", on_a_full_disk)
    result = omnilab_here(*SMALL)
    assert result.rc == 0, result.stderr
    run = load_run(tmp_path / "logs/latest")
    check_dropped(run, result.stderr, "rerun", RERUN_FULL)
    check_mcap(run)


@pytest.mark.slow
def test_both_logs_on_a_disk_that_fills_up(omnilab_here, tmp_path):
    """No file may grow beyond 1 MB, which the logs of this run would and nothing else does."""
    limit = 1_000_000
    done = subprocess.run(
        [Path(sys.executable).with_name("omnilab"), *SMALL, "study.query_count=3000", "study.show=3000"],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
        cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    run = load_run(tmp_path / "logs" / "latest")
    assert run.state == "done"
    assert set(run.status["sinks_dropped"]) == {"rerun", "mcap"}
    assert run.metrics["queries"] == 3000
    for name, cause in (("rerun", RERUN_FULL), ("mcap", "File too large")):
        assert re.search(cause, run.status["sinks_dropped"][name])
        assert f"sink '{name}' failed" in done.stderr
    mended = omnilab_here("repair", str(run.folder))  # what had room before
    assert mended.rc == 0, mended.stderr
    check_mcap(run)
    check_rrd(run)


@pytest.mark.parametrize(
    ("name", "file"), [("rerun", "run.rrd"), pytest.param("mcap", "run.mcap", marks=pytest.mark.slow)]
)
def test_a_sink_left_out_writes_nothing(omnilab_here, tmp_path, name, file):
    result = omnilab_here(*SMALL, f"~sink@sinks.{name}")
    assert result.rc == 0, result.stderr
    run = load_run(tmp_path / "logs" / "latest")
    assert not (run.folder / file).exists()
    assert {"run.rrd", "run.mcap"} - {file} <= {path.name for path in run.folder.iterdir()}
    assert set(run.config["sinks"]) == {"console", "rerun", "mcap"} - {name}


# ------------------------------------------------------------------------------------------- live
def listening(port: int) -> set[str]:
    """Addresses that something listens on at a port, as the kernel writes them."""
    found = set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            address, number = line.split()[1].split(":")
            if line.split()[3] == "0A" and int(number, 16) == port:
                found.add(address)
    return found


def wait_for(condition: Callable[[], object], timeout_s: float = 60) -> None:
    end = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="reads Linux's table of sockets")
def test_live_serves_loopback_only(tmp_path):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    endless = ["study.query_count=100000", "sensor.batch=8", "sinks.rerun.live=true", f"sinks.rerun.port={port}"]
    with subprocess.Popen(
        [Path(sys.executable).with_name("omnilab"), *SMALL, *endless],
        cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    ) as process:  # fmt: skip
        try:
            wait_for(lambda: listening(port) or process.poll() is not None)
            assert listening(port) == {"0100007F"}  # 127.0.0.1 and nothing else
            socket.create_connection(("127.0.0.1", port), timeout=5).close()
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(timeout=60)
    assert process.returncode == 130
    assert not listening(port)
    assert load_run(tmp_path / "logs" / "latest").state == "interrupted"


@pytest.mark.slow
def test_a_taken_live_port_costs_the_sink_and_not_the_run(omnilab_here, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        result = omnilab_here(*SMALL, "sinks.rerun.live=true", f"sinks.rerun.port={port}")
    assert result.rc == 0, result.stderr
    run = load_run(tmp_path / "logs" / "latest")
    check_dropped(run, result.stderr, "rerun", str(port))
    check_mcap(run)


# ------------------------------------------------------------------------------------------- sweeps
COUNTS = '''
"""A study that says how many threads and open files its process has, and fails with every second seed."""
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar
from omnilab import Metric, Report, hookimpl
from omnilab.api import Text, Tick

@dataclass
class Counts:
    """Counts."""
    fails: bool = False
    needs: ClassVar[tuple[str, ...]] = ()
    def run(self, parts, record, rng):
        record.log("log", Text("one line"), Tick(0, 0))
        counts = [len(list(Path(folder).iterdir())) for folder in ("/proc/self/task", "/proc/self/fd")]
        with open("counts.txt", "a") as file:
            print(*counts, file=file)
        if self.fails:
            raise ValueError("as it should")
        return Report([Metric("threads", counts[0], "1")])

@hookimpl
def register_studies(register):
    register("counts", Counts)
'''


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="threads are counted in Linux's /proc")
@pytest.mark.parametrize("ends", ["well", "in failures", "without its sinks"])
def test_a_sweep_of_many_jobs_has_the_threads_and_files_of_one(tmp_path, monkeypatch, ends):
    (tmp_path / "counts.py").write_text(COUNTS)
    (tmp_path / "full.py").write_text(DISK_FULL)
    monkeypatch.setenv("OMNILAB_PLUGINS", "counts.py,full.py")
    call = ["-m", "experiment=pose_graph", "study=counts", f"seed={','.join(map(str, range(12)))}"]
    if ends == "in failures":
        call.append("study.fails=true")
    if ends == "without its sinks":
        call += ["+sink@sinks.full=full", "sinks.full.room=0"]
    subprocess.run(
        [Path(sys.executable).with_name("omnilab"), *call], cwd=tmp_path, capture_output=True, timeout=1800, check=False
    )
    counts = [tuple(map(int, line.split())) for line in (tmp_path / "counts.txt").read_text().splitlines()]
    assert len(counts) == 12
    threads, files = zip(*counts, strict=True)
    assert max(threads[2:]) <= threads[1] + 1, threads  # one may be about to end
    assert max(files[2:]) <= files[1] + 1, files
