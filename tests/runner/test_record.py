"""The recorder: who gets what, and what a failing sink costs."""

import contextlib
import threading
from dataclasses import dataclass

import pytest

from omnilab.api import Progress, Text
from omnilab.runner.recorder import Recorder
from omnilab.testing import sample_records


@dataclass
class Memory:
    """Keeps what it is given."""

    fails_at: int = -1

    def __post_init__(self):
        self.taken, self.events = [], []

    def open(self, folder):
        self.events.append("open")

    def write(self, path, record, tick):
        if len(self.taken) == self.fails_at:
            raise OSError(28, "No space left on device")
        self.taken.append((path, record, tick))

    def flush(self):
        self.events.append("flush")

    def close(self):
        self.events.append("close")

    def repair(self, folder):
        return None


def test_every_sink_gets_every_record_in_order():
    sinks = {"a": Memory(), "b": Memory()}
    with Recorder(sinks) as record:
        for item in sample_records():
            record.log(*item)
    assert [path for path, _, _ in sinks["a"].taken] == [path for path, _, _ in sample_records()]
    assert len(sinks["a"].taken) == len(sinks["b"].taken)
    assert sinks["a"].events[0] == "open"
    assert sinks["a"].events[-1] == "close"


def test_a_failing_sink_is_dropped_and_the_others_go_on(caplog):
    good, bad = Memory(), Memory(fails_at=2)
    with Recorder({"bad": bad, "good": good}) as record:
        for item in sample_records():
            record.log(*item)
    assert len(good.taken) == len(list(sample_records()))
    assert len(bad.taken) == 2
    assert "No space left" in record.dropped["bad"]
    assert "sink 'bad' failed" in caplog.text


def test_a_sink_that_would_end_the_process_is_dropped():
    class Exits(Memory):
        def flush(self):
            raise SystemExit(3)

        close = flush

    with Recorder({"exits": Exits()}) as record:
        record.log("log", Text("a line"))
    assert record.dropped == {"exits": "SystemExit: 3"}


def test_progress_counts_the_parts_of_each_item():
    sink = Memory()
    with Recorder({"s": sink}) as record:
        assert list(record.track([[1, 2], [3]], "stage", 3)) == [[1, 2], [3]]
    done = [(r.done, r.total) for _, r, _ in sink.taken if isinstance(r, Progress)]
    assert done == [(0, 3), (2, 3), (3, 3)]


def test_stages_add_up_even_when_they_raise():
    record = Recorder()
    with record.timed("a", 2):
        pass
    with pytest.raises(ValueError, match="x"), record.timed("a", 3):
        raise ValueError("x")
    seconds, count = record.costs["a"]
    assert count == 5
    assert seconds >= 0


def test_sinks_are_flushed_every_second_while_the_study_thinks():
    sink, flushed = Memory(), threading.Event()
    sink.flush = flushed.set
    with Recorder({"s": sink}):
        assert flushed.wait(10)


def test_an_interrupt_waits_until_the_record_is_whole():
    class Interrupting(Memory):
        def write(self, path, record, tick):
            recorder.interrupt()  # the signal arrives in the middle of a write
            super().write(path, record, tick)

    sink, other = Interrupting(), Memory()
    recorder = Recorder({"first": sink, "second": other})
    with pytest.raises(KeyboardInterrupt), recorder:
        recorder.log("log", Text("whole"))
    assert len(sink.taken) == len(other.taken) == 1
    assert other.events[-1] == "close"
    with pytest.raises(KeyboardInterrupt):
        recorder.interrupt()  # and between records it is immediate


def test_an_interrupt_that_a_library_swallows_is_raised_by_the_next_record():
    record = Recorder({"s": Memory()})
    with contextlib.suppress(BaseException):  # what some libraries do
        record.interrupt()
    with pytest.raises(KeyboardInterrupt), record:
        record.log("log", Text("one more"))
    record.log("log", Text("all is closed"))
