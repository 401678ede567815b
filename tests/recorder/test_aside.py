"""What is logged in a thread of its own while the study goes on: order, errors, patience, Ctrl-C."""

from __future__ import annotations

import os
import signal
import threading
import time

import pytest

from omnilab.api import Text
from omnilab.runner.interrupts import HeldSignals
from omnilab.runner.recorder import Recorder, aside, outputs, recorder


class Sink:
    """Keeps the texts it is given; each write waits until it may go on."""

    def __init__(self, held: bool = False) -> None:
        self.texts: list[str] = []
        self.threads: set[str] = set()
        self.closed, self.go = False, threading.Event()
        if not held:
            self.go.set()

    def open(self, folder):
        pass

    def write(self, path, record, tick):
        self.go.wait(60)
        self.texts.append(record.text)
        self.threads.add(threading.current_thread().name)

    def flush(self):
        pass

    def close(self):
        self.closed = True

    def repair(self, folder):
        return None


def test_all_is_written_in_order_by_another_thread_before_the_study_goes_on():
    sink = Sink()
    with Recorder({"s": sink}) as record:
        with record.aside() as later:
            for i in range(20):
                later(lambda i=i: record.log("log", Text(f"{i}")))
        record.log("log", Text("behind"))
    assert sink.texts == [*map(str, range(20)), "behind"]
    assert sink.threads == {"omnilab-aside", threading.main_thread().name}


def test_few_actions_wait_and_the_study_with_them():
    sink, done = Sink(held=True), []
    with Recorder({"s": sink}) as record, record.aside() as later:

        def study() -> None:
            for i in range(aside.MOST + 2):
                later(lambda i=i: record.log("log", Text(f"{i}")))
                done.append(i)

        thread = threading.Thread(target=study)
        thread.start()
        end = time.monotonic() + 10
        while len(done) < aside.MOST + 1 and time.monotonic() < end:
            time.sleep(0.01)
        time.sleep(0.1)
        assert done == list(range(aside.MOST + 1))  # one at work, MOST that wait
        sink.go.set()
        thread.join(10)
    assert len(sink.texts) == aside.MOST + 2


def test_an_error_of_an_action_is_the_studys_and_nothing_is_logged_behind_it():
    sink = Sink()

    def breaks() -> None:
        raise ZeroDivisionError("of the drawing")

    with pytest.raises(ZeroDivisionError, match="of the drawing"), Recorder({"s": sink}) as record:  # noqa: PT012, SIM117  as runs are
        with record.aside() as later:
            later(breaks)
            later(lambda: record.log("log", Text("behind")))
    assert sink.texts == []
    assert sink.closed


def test_an_error_of_the_study_comes_before_those_of_actions():
    sink = Sink()
    with pytest.raises(ValueError, match="of the study"), Recorder({"s": sink}) as record, record.aside() as later:  # noqa: PT012
        later(lambda: record.log("log", Text("before")))
        raise ValueError("of the study")
    assert sink.texts == ["before"]


def test_without_sinks_an_action_is_run_at_once():
    ran, record = [], Recorder()
    with record.aside() as later:
        later(lambda: ran.append(threading.current_thread()))
        assert ran == [threading.main_thread()]


def test_ctrl_c_ends_a_run_whose_sink_hangs_in_that_thread(monkeypatch):
    monkeypatch.setattr(recorder, "PATIENCE_S", 0.3)
    monkeypatch.setattr(outputs, "DROPPED_S", 0.2)
    hung, good = Sink(held=True), Sink()
    record = Recorder({"good": good, "hung": hung})
    timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt), HeldSignals() as signals, signals.heard(record.interrupt), record:  # noqa: PT012, SIM117
        with record.aside() as later:
            while True:
                later(lambda: record.log("log", Text("x")))
    timer.join()
    hung.go.set()
    assert record.dropped == {"hung": "it hung when the run ended"}
    assert good.closed
