"""The recorder: who gets what, and what a failing sink costs."""

import contextlib
import re
import threading
from dataclasses import dataclass

import numpy as np
import pytest

from omnilab.api import Answers, DistanceField, Image, Progress, RunResult, Series, Text
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


def test_a_sink_that_takes_the_result_gets_it_before_it_is_closed_and_others_go_on(caplog):
    class Concludes(Memory):
        def conclude(self, result):
            self.events.append(result)

    class Refuses(Memory):
        def conclude(self, result):
            raise ValueError(f"what is {result.status}?")

    sinks, result = {"of before": Memory(), "new": Concludes(), "bad": Refuses()}, RunResult("done")
    with Recorder(sinks) as record:
        record.result = result
    assert [event for event in sinks["new"].events if event != "flush"] == ["open", result, "close"]
    for name in ("of before", "bad"):
        assert [event for event in sinks[name].events if event != "flush"] == ["open", "close"]
    assert record.dropped == {}
    assert "sink 'bad' cannot take the record 'result'" in caplog.text


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
    (line,) = [r.text for path, r, _ in sink.taken if path == "log"]
    assert re.fullmatch(r"stage: 3 done in \d+\.\d s", line)


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


# ------------------------------------------------------------------------------------------- what sinks are given
def test_a_sink_cannot_write_into_what_the_study_logged(caplog):
    class Scribbles(Memory):
        def write(self, path, record, tick):
            super().write(path, record, tick)
            record.values[0] = 77

    sink, values = Scribbles(), np.zeros(3)
    with Recorder({"s": sink}) as record:
        record.log("/field", DistanceField(np.zeros((3, 3)), values))
    (given,) = [given for _, given, _ in sink.taken]
    assert values.tolist() == [0, 0, 0]
    assert values.flags.writeable
    assert np.shares_memory(given.values, values), "a view, no copy"
    assert "sink 's' cannot take the record '/field'" in caplog.text


def test_a_list_of_the_study_is_its_own():
    sink, verdicts = Memory(), ["wrong"]
    with Recorder({"s": sink}) as record:
        record.log("/answers", Answers(np.zeros((1, 3)), np.zeros((1, 3)), verdicts))
    (given,) = [given for _, given, _ in sink.taken]
    given.verdict.clear()
    assert verdicts == ["wrong"]
    assert not given.truth_m.flags.writeable


@pytest.mark.parametrize("wrong", [ValueError("NaN"), TypeError("no"), IndexError("far"), ZeroDivisionError("0")])
def test_a_record_that_a_sink_has_no_form_for_costs_that_record(caplog, wrong):
    class Picky(Memory):
        def write(self, path, record, tick):
            if record.text == "odd":
                raise wrong
            super().write(path, record, tick)

    picky, other = Picky(), Memory()
    with Recorder({"picky": picky, "other": other}) as record:
        for text in ["plain", "odd", "odd", "plain"]:
            record.log("log", Text(text))
    assert len(picky.taken) == 2
    assert len(other.taken) == 4
    assert record.dropped == {}
    assert caplog.text.count("cannot take the record 'log'") == 1
    assert "sink 'picky' has left out 2 records" in caplog.text


def test_a_sink_that_takes_no_record_is_dropped(caplog):
    class Broken(Memory):
        def write(self, path, record, tick):
            raise AttributeError("a bug")

    with Recorder({"broken": Broken()}) as record:
        for _ in range(30):
            record.log("log", Text("x"))
    assert "it could take none of 10 records, at last 'log': AttributeError: a bug" in record.dropped["broken"]
    assert [line.levelname for line in caplog.records].count("WARNING") == 2, "of one record, and of all"


@pytest.mark.parametrize("pixels", [np.zeros((0, 0), np.uint8), np.zeros((4, 4, 3)), np.zeros((2, 3, 4, 5), np.uint8)])
def test_what_is_no_picture_costs_no_run(caplog, pixels):
    sink = Memory()
    with Recorder({"s": sink}) as record:
        for _ in range(2):
            record.log("camera", Image(pixels))
        record.log("log", Text("and on"))
    assert sink.taken[-1][1] == Text("and on")
    if len(sink.taken) == 1:
        assert caplog.text.count("'camera' is no picture and left out of the logs") == 1


@pytest.mark.parametrize(
    ("record", "words"),
    [
        (Series([0.5], np.array([0]), np.array([0]), "m"), "Series with `values` as list, not as an array (any,)"),
        (Series(np.zeros(2), np.arange(3), np.arange(2), "m"), "Series with `steps` of shape (3,), not (2,)"),
        (Series(np.zeros(2), np.zeros(2), np.arange(2), "m"), "Series with `steps` of type float64, not whole"),
        (3.5, "float; log an Image"),
    ],
)
def test_what_is_no_record_is_said_once_and_no_sink_sees_it(caplog, record, words):
    sink = Memory()
    with Recorder({"memory": sink}) as recorder:
        for _ in range(2):
            recorder.log("error", record)
        recorder.log("error", Series(np.array([np.nan]), np.arange(1), np.arange(1), "m"))
    assert caplog.text.count("'error' is no record and left out of the logs: " + words) == 1
    assert len(sink.taken) == 1


def test_what_has_no_size_counts_as_one():
    sink = Memory()
    with Recorder({"memory": sink}) as recorder:
        assert list(recorder.track(range(3), "numbers", 3)) == [0, 1, 2]
        list(recorder.track([np.zeros(2), np.zeros(1)], "batches", 3))
    done = [(r.stage, r.done) for _, r, _ in sink.taken if isinstance(r, Progress)]
    assert done == [("numbers", n) for n in range(4)] + [("batches", n) for n in (0, 2, 3)]
