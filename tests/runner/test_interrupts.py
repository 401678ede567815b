"""Runs that are ended from outside, at whatever moment: their logs are complete, or can be mended."""

from __future__ import annotations

import json
import os
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, make_reader
from mcap_protobuf.decoder import DecoderFactory
from rerun.chunk import RrdReader

from omnilab.runner import cli, discovery
from omnilab.runner.registry import Registry

SCRIPT = Path(sys.executable).with_name("omnilab")
WORLD = Path(__file__).parents[1] / "box_world.yaml"
ENDLESS = [  # long enough in either stage to be interrupted there
    "experiment=quickstart", f"sensor.world={WORLD}", "sensor.size=96", "sensor.samples=1", "sensor.batch=8",
    "descriptor.offsets=48", "descriptor.angles=60", "study.show=1000", "study.query_count=100000",
]  # fmt: skip
STEP = {"places": "study.step_m=0.01", "queries": "study.step_m=0.5"}
LOST_S = 2.0  # at most: a second between two flushes, and one for a busy machine


class Started:
    """A run in a process of its own."""

    def __init__(self, here: Path, *arguments: str) -> None:
        self.here = here
        self.process = subprocess.Popen(
            [SCRIPT, *arguments, *ENDLESS], cwd=here, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        self.stderr = ""
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        for line in self.process.stderr:
            self.stderr += line

    def wait_until(self, there: Callable[[], bool], timeout_s: float = 90) -> None:
        end = time.monotonic() + timeout_s
        while not there():
            assert self.process.poll() is None, f"ended by itself: {self.stderr}"
            assert time.monotonic() < end, f"it takes too long: {self.stderr}"
            time.sleep(0.05)

    def end(self, number: signal.Signals) -> int:
        """Send a signal; the exit code."""
        self.process.send_signal(number)
        code = self.process.wait(timeout=60)
        self._reader.join(timeout=10)
        return code

    @property
    def folder(self) -> Path:
        return (self.here / "logs" / "latest").resolve()

    def begun(self) -> bool:
        """Whether the log holds a message: what it says of the run comes before."""
        try:
            with (self.folder / "run.mcap").open("rb") as stream:
                return any(True for _ in NonSeekingReader(stream).iter_messages(log_time_order=False))
        except (OSError, McapError, struct.error):  # none yet, or half of one
            return False

    @property
    def status(self) -> dict[str, object]:
        return json.loads((self.folder / "status.json").read_text())


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Started]]:
    started: list[Started] = []

    def start(*arguments: str) -> Started:
        started.append(Started(tmp_path, *arguments))
        return started[-1]

    yield start
    for run in started:
        run.process.kill()
        run.process.wait()
        run.process.stdout.close()
        run._reader.join(timeout=10)
        run.process.stderr.close()


def until_stage(run: Started, stage: str) -> None:
    """Wait until a run has spent a moment in a stage."""
    run.wait_until(run.begun)
    if stage == "queries":
        run.wait_until(lambda: "places " in run.stderr)
    time.sleep(1.0)


def mcap_of(folder: Path) -> tuple[list[int], int]:
    """The steps whose error the log holds, in order, and the last log time; the file has its index."""
    steps = []
    last = count = 0
    with (folder / "run.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        for _, channel, message, decoded in reader.iter_decoded_messages():
            last, count = max(last, message.log_time), count + 1
            if channel.topic == "/error/position_m":
                steps.append(decoded.step)
    assert summary is not None
    assert summary.statistics.message_count == count > 0
    return sorted(steps), last


def rrd_of(folder: Path) -> tuple[list[int], int]:
    """The steps whose error the recording holds, in order, and the last log time; Rerun's own check passes."""
    verified = subprocess.run(
        [Path(find_spec("rerun_cli").origin).with_name("rerun"), "rrd", "verify", folder / "run.rrd"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert verified.returncode == 0, verified.stderr
    steps, last = [], 0
    for chunk in RrdReader(folder / "run.rrd").stream().to_chunks():
        batch = chunk.to_record_batch()
        if "log_time" in batch.schema.names and chunk.num_rows:
            last = max(last, *batch.column("log_time").cast("int64").to_pylist())
        if chunk.entity_path == "/error/position_m" and "step" in batch.schema.names:
            steps += batch.column("step").cast("int64").to_pylist()
    return sorted(steps), last


# ------------------------------------------------------------------------------------------- Ctrl-C, SIGTERM and SIGHUP
@pytest.mark.parametrize(
    ("number", "stage"),
    [
        (signal.SIGINT, "places"),
        pytest.param(signal.SIGTERM, "places", marks=pytest.mark.slow),
        pytest.param(signal.SIGINT, "queries", marks=pytest.mark.slow),
        pytest.param(signal.SIGTERM, "queries", marks=pytest.mark.slow),
        pytest.param(signal.SIGHUP, "queries", marks=pytest.mark.slow),
    ],
    ids=lambda value: getattr(value, "name", value),
)
def test_an_interrupted_run_has_complete_logs(start, omnilab_here, number, stage):
    run = start(STEP[stage])
    until_stage(run, stage)
    assert run.end(number) == 130
    assert "interrupted" in run.stderr.splitlines()[-1]
    assert "Traceback" not in run.stderr
    assert run.status["status"] == "interrupted"
    assert run.status["sinks_dropped"] == {}
    assert not (run.folder / "metrics.csv").exists()
    assert (run.folder / "cost.csv").exists()

    steps, _ = mcap_of(run.folder)
    assert steps == list(range(len(steps)))
    assert (len(steps) > 0) == (stage == "queries")
    assert rrd_of(run.folder)[0] == steps
    assert "nothing to repair" in omnilab_here("repair", str(run.folder)).stderr


@pytest.mark.slow
def test_an_impatient_user_presses_ctrl_c_again(start):
    run = start(STEP["queries"])
    until_stage(run, "queries")
    for _ in range(3):
        run.process.send_signal(signal.SIGINT)
        time.sleep(0.02)
    assert run.end(signal.SIGINT) != 0
    mcap_of(run.folder)
    rrd_of(run.folder)
    assert run.status["status"] == "interrupted"


@pytest.mark.slow
def test_ctrl_c_ends_a_sweep(start, tmp_path):
    run = start("-m", "seed=0,1,2", STEP["queries"])
    until_stage(run, "queries")
    assert run.end(signal.SIGINT) == 130
    assert run.status["status"] == "interrupted"
    jobs = [path for path in run.folder.parent.iterdir() if path.is_dir()]
    assert jobs == [run.folder], "the jobs to come were not begun"


@pytest.mark.slow
def test_ctrl_c_before_the_run(start, tmp_path):
    run = start(STEP["queries"])
    time.sleep(0.3)
    assert run.end(signal.SIGINT) in {130, -signal.SIGINT}
    assert not (tmp_path / "logs").exists() or run.status["status"] == "interrupted"


# ------------------------------------------------------------------------------------------- SIGKILL
@pytest.mark.slow
def test_a_killed_run_can_be_mended(start, omnilab_here):
    run = start(STEP["queries"])
    until_stage(run, "queries")
    time.sleep(2.5)
    refused = omnilab_here("repair", str(run.folder))
    assert refused.rc == 2
    assert f"still running (process {run.process.pid})" in refused.stderr
    assert " running " in omnilab_here("runs").stdout

    killed_ns = time.time_ns()
    assert run.end(signal.SIGKILL) == -signal.SIGKILL
    assert run.status["status"] == "running", "nobody was left to write another"
    assert " killed " in omnilab_here("runs").stdout

    mended = omnilab_here("repair", str(run.folder))
    assert mended.rc == 0, mended.stderr
    assert "run.mcap" in mended.stderr
    for steps, last_ns in (mcap_of(run.folder), rrd_of(run.folder)):
        assert (killed_ns - last_ns) / 1e9 < LOST_S
        assert len(steps) > 100
        assert steps == list(range(len(steps))), "there is a hole"

    assert " killed " in omnilab_here("runs").stdout
    again = omnilab_here("repair", str(run.folder))
    assert again.rc == 0
    assert "nothing to repair" in again.stderr


def test_ctrl_c_that_a_library_would_swallow_is_not_lost(monkeypatch):
    def importing():
        try:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.2)
        except BaseException:  # noqa: BLE001  as some libraries do
            pass
        return Registry()

    monkeypatch.setattr(discovery, "discover", importing)
    with pytest.raises(SystemExit) as ended:
        cli.main(["experiment=quickstart"])
    assert ended.value.code == 130


def test_ctrl_c_while_libraries_are_imported_ends_the_command():
    """Many of them would swallow it, or make another error of it."""
    script = """
import os, signal, sys
from omnilab.__main__ import main
assert "numpy" not in sys.modules
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "numpy":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Finder())
main()
"""
    ended = subprocess.run([sys.executable, "-c", script], check=False, capture_output=True, text=True)
    assert (ended.returncode, ended.stderr) == (130, "")
