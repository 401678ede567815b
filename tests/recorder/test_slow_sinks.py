"""Sinks that are slow, or hang: what they cost the run, its other sinks, and who presses Ctrl-C."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path

import pytest

from omnilab.api import Text
from omnilab.runner.interrupts import HeldSignals
from omnilab.runner.recorder import Recorder, outputs


class Sink:
    """Counts what it is asked to do, and waits in one of its methods until the test ends."""

    def __init__(self, hangs: str = "", seconds: float = 60.0) -> None:
        self.hangs, self.seconds = hangs, seconds
        self.calls: list[str] = []
        self.free = threading.Event()

    def _do(self, what):
        if what == self.hangs:
            self.calls.append(f"{what} begins")
            self.free.wait(self.seconds)
        self.calls.append(what)

    def open(self, folder):
        self._do("open")

    def write(self, path, record, tick):
        self._do("write")

    def flush(self):
        self._do("flush")

    def close(self):
        self._do("close")

    def repair(self, folder):
        return None


@pytest.fixture(autouse=True)
def hasty(monkeypatch):
    """All that is waited for comes sooner."""
    for name, seconds in (
        ("FLUSH_S", 0.05),
        ("PATIENCE_S", 0.3),
        ("STUCK_S", 1.0),
        ("LOOK_S", 0.02),
        ("DROPPED_S", 0.2),
    ):
        monkeypatch.setattr(outputs, name, seconds)


@pytest.fixture
def sinks():
    """One that is as it should be, and one that each test makes; freed when the test ends."""
    made = {"good": Sink()}
    yield made
    for sink in made.values():
        sink.free.set()


def until(there) -> None:
    end = time.monotonic() + 30
    while not there():
        assert time.monotonic() < end, "it takes too long"
        time.sleep(0.01)


def press(after_s: float) -> threading.Timer:
    """Ctrl-C, in a while."""
    timer = threading.Timer(after_s, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    return timer


def test_a_flush_that_hangs_delays_no_other_sink(sinks):
    sinks["bad"] = Sink("flush")
    with Recorder(sinks) as record:
        until(lambda: "flush begins" in sinks["bad"].calls)
        before = len(sinks["good"].calls)
        until(lambda: sinks["good"].calls[before:].count("flush") > 2)
        record.log("log", Text("x"))  # waits for the lock of the other one, for a while
        assert sinks["good"].calls.count("write") == 1
        assert "does not come back" in record.dropped["bad"]
        record.log("log", Text("y"))
    assert "write" not in sinks["bad"].calls
    assert sinks["good"].calls[-1] == "close"


def test_a_slow_flush_is_waited_for(sinks):
    sinks["slow"] = Sink("flush", 0.3)
    with Recorder(sinks) as record:
        until(lambda: "flush begins" in sinks["slow"].calls)
        record.log("log", Text("x"))
    assert "write" in sinks["slow"].calls
    assert record.dropped == {}


@pytest.mark.parametrize("method", ["write", "open"])
@pytest.mark.parametrize("first", [True, False])
def test_ctrl_c_ends_a_run_whose_sink_hangs(sinks, method, first):
    bad = Sink(method)
    both = {"bad": bad, **sinks} if first else {**sinks, "bad": bad}
    sinks["bad"] = bad
    recorder, timer = Recorder(both), press(0.2)
    with pytest.raises(KeyboardInterrupt), HeldSignals() as signals, signals.heard(recorder.interrupt), recorder:  # noqa: PT012  as runs are
        recorder.log("log", Text("x"))
        recorder.log("log", Text("y"))
    timer.join()
    assert "hung when the run was interrupted" in recorder.dropped["bad"]
    assert sinks["good"].calls.count("write") == (method == "write")
    assert sinks["good"].calls[-1] == "close"


def test_ctrl_c_while_a_sinks_flush_hangs(sinks, monkeypatch):
    monkeypatch.setattr(outputs, "STUCK_S", 60.0)
    sinks["bad"] = Sink("flush")
    recorder = Recorder(sinks)
    with pytest.raises(KeyboardInterrupt), HeldSignals() as signals, signals.heard(recorder.interrupt), recorder:  # noqa: PT012  as runs are
        until(lambda: "flush begins" in sinks["bad"].calls)
        timer = press(0.2)
        recorder.log("log", Text("x"))
        pytest.fail("the record waits for the lock")
    timer.join()
    assert list(recorder.dropped) == ["bad"]
    assert sinks["good"].calls[-1] == "close"


@pytest.mark.parametrize("first", [True, False])
def test_a_close_that_hangs_keeps_no_other_sink_from_its_file(sinks, first):
    bad = Sink("close")
    both = {"bad": bad, **sinks} if first else {**sinks, "bad": bad}
    sinks["bad"] = bad
    with Recorder(both) as recorder:
        recorder.log("log", Text("x"))
    assert sinks["good"].calls[-1] == "close"
    assert "does not complete its file" in recorder.dropped["bad"]


def test_ctrl_c_while_files_are_completed_waits_for_them(sinks):
    sinks["slow"] = Sink("close", 0.2)
    recorder = Recorder(sinks)
    with pytest.raises(KeyboardInterrupt), HeldSignals() as signals, signals.heard(recorder.interrupt), recorder:
        timer = press(0.1)
    timer.join()
    assert sinks["slow"].calls[-1] == sinks["good"].calls[-1] == "close"
    assert recorder.dropped == {}


def test_ctrl_c_while_a_close_hangs(sinks, monkeypatch):
    monkeypatch.setattr(outputs, "STUCK_S", 60.0)
    sinks["bad"] = Sink("close")
    recorder = Recorder(sinks)
    with pytest.raises(KeyboardInterrupt), HeldSignals() as signals, signals.heard(recorder.interrupt), recorder:
        timer = press(0.1)
    timer.join()
    assert list(recorder.dropped) == ["bad"]
    assert sinks["good"].calls[-1] == "close"


def test_a_failed_sink_is_closed_and_its_thread_ends(sinks):
    class Full(Sink):
        def write(self, path, record, tick):
            raise OSError(28, "No space left on device")

    sinks["full"] = Full()
    with Recorder(sinks) as recorder:
        recorder.log("log", Text("x"))
        until(lambda: "close" in sinks["full"].calls)
    assert list(recorder.dropped) == ["full"]


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="threads are counted in Linux's /proc")
@pytest.mark.parametrize("raises", ["", "open", "write", "flush", "close"])
def test_the_threads_of_recorders_end_with_them(raises):
    class Fails(Sink):
        def _do(self, what):
            super()._do(what)
            if what == raises:
                raise OSError(what)

    before = threading.active_count()
    for _ in range(5):
        with Recorder({"a": Sink(), "b": Fails()}) as recorder:
            recorder.log("log", Text("x"))
            if raises == "flush":
                until(lambda: recorder.dropped)
        assert list(recorder.dropped) == ["b"] * bool(raises)
    until(lambda: threading.active_count() == before)
