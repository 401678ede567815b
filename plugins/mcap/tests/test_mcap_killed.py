"""What is in the file while a run goes on: everything, whenever the process is killed, and when the disk is full."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from omnilab import api
from omnilab_mcap import McapSink, writer

HOLD_THE_GIL = """
import ctypes, sys
from pathlib import Path
import numpy as np
from omnilab.api import Series, Text, Tick
from omnilab_mcap import McapSink
sink = McapSink()
sink.open(Path(sys.argv[1]))
for step in range(30):
    sink.write("log", Text(f"line {step}"), Tick(step, step))
    sink.write("curve", Series(np.array([0.5]), np.array([step]), np.array([step]), "m"), None)
print("logged", flush=True)
ctypes.PyDLL(None).sleep(600)  # in a C library that does not give Python's lock back
"""


def steps_of(path, topic="/log"):
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_summary() is not None
        return [message.sequence for _, channel, message in reader.iter_messages() if channel.topic == topic]


def lines(sink, first, count, text="x" * 200):
    for step in range(first, first + count):
        sink.write("log", api.Text(text), api.Tick(step, step))


def test_what_was_logged_before_a_library_holds_pythons_lock_is_in_the_file(tmp_path):
    call = [sys.executable, "-c", HOLD_THE_GIL, str(tmp_path)]
    with subprocess.Popen(call, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "logged\n"
        time.sleep(0.2)
        process.kill()
    McapSink().repair(tmp_path)
    for topic in ("/log", "/curve"):
        assert steps_of(tmp_path / "run.mcap", topic) == list(range(30))


@pytest.mark.parametrize("flushed", [0, 7, 10])
def test_every_record_is_in_the_file_at_once(tmp_path, flushed):
    sink = McapSink()
    sink.open(tmp_path)
    lines(sink, 0, flushed)
    sink.flush()
    lines(sink, flushed, 10 - flushed)
    copy = tmp_path / "killed"
    copy.mkdir()
    (copy / "run.mcap").write_bytes((tmp_path / "run.mcap").read_bytes())
    McapSink().repair(copy)
    assert steps_of(copy / "run.mcap") == list(range(10))
    sink.close()
    assert steps_of(tmp_path / "run.mcap") == list(range(10)), "each once"
    assert McapSink().repair(tmp_path) is None


@pytest.mark.parametrize("call", ["pwrite", "ftruncate"])
@pytest.mark.parametrize("text", ["x" * 200, ""], ids=["shorter", "longer"])
def test_killed_while_a_chunk_is_written_over_its_records(tmp_path, monkeypatch, call, text):
    """Before each call that does it, the file holds all that was logged; chunks may be longer or shorter than records."""
    rng, states = np.random.default_rng(0), []
    real = getattr(os, call)

    def killed(*arguments):
        states.append((tmp_path / "run.mcap").read_bytes())
        return real(*arguments)

    sink = McapSink()
    sink.open(tmp_path)
    for step in range(5):  # what JPEG makes cannot be compressed
        sink.write("camera", api.Image(np.zeros((2, 2), np.uint8), encoded=rng.bytes(3000)), api.Tick(step, step))
    lines(sink, 0, 40, text)
    monkeypatch.setattr(writer.os, call, killed)
    sink.flush()
    monkeypatch.undo()
    sink.close()
    assert states
    for i, state in enumerate(states):
        copy = tmp_path / str(i)
        copy.mkdir()
        (copy / "run.mcap").write_bytes(state)
        McapSink().repair(copy)
        assert steps_of(copy / "run.mcap") == list(range(40))
        assert steps_of(copy / "run.mcap", "/camera") == list(range(5))


@pytest.mark.parametrize("at", range(1, 13))
def test_a_full_disk_loses_nothing_that_had_room(tmp_path, monkeypatch, at):
    """At whichever write it is full: the sink says so, and what it had taken can be read back."""
    count, real, taken = 0, os.pwrite, 0

    def full(file, data, offset):
        nonlocal count
        count += 1
        end = (tmp_path / "run.mcap").stat().st_size
        if count >= at and offset + len(data) > end:  # what is there may be written over
            if room := max(0, end - offset + 5):
                real(file, data[:room], offset)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return real(file, data, offset)

    sink, handles = McapSink(), len(list(Path("/dev/fd").iterdir()))
    sink.open(tmp_path)
    sink.write("log", api.Text("first"), api.Tick(0, 0))
    monkeypatch.setattr(writer.os, "pwrite", full)
    with pytest.raises(OSError, match="No space left"):  # noqa: PT012  at one of these calls
        for taken in range(1, 20):
            sink.write("log", api.Text("x" * 50), api.Tick(taken, taken))
            if taken % 4 == 0:
                sink.flush()
    try:
        sink.close()
    except OSError:
        McapSink().repair(tmp_path)
    steps = steps_of(tmp_path / "run.mcap")
    assert steps == list(range(len(steps)))
    assert len(steps) >= taken
    assert len(list(Path("/dev/fd").iterdir())) == handles


def test_what_does_not_fit_its_field_costs_the_record_and_not_the_file(tmp_path):
    sink = McapSink()
    sink.open(tmp_path)
    lines(sink, 0, 3)
    for path, tick in (
        ("log", api.Tick(-1, 0)),
        ("log", api.Tick(2**32, 0)),
        ("\ud800", None),
    ):
        with pytest.raises(ValueError, match=r"does not fit|surrogates not allowed"):
            sink.write(path, api.Text("odd"), tick)
    with pytest.raises(ValueError, match="surrogates"):
        sink.write("log", api.Text("\ud800"), None)
    lines(sink, 3, 3)
    sink.close()
    assert steps_of(tmp_path / "run.mcap") == list(range(6))


def test_arrays_may_change_once_they_are_logged(tmp_path, read):
    sink, values = McapSink(), np.zeros((2, 3), np.float32)
    sink.open(tmp_path)
    sink.write("signature", api.Signature(values), api.Tick(0, 0))
    values[...] = 77
    sink.close()
    (message,) = read(tmp_path / "run.mcap")["/signature"]
    assert not any(message.decoded.data)


def test_chunks_that_are_full_are_completed_without_a_flush(tmp_path):
    sink, rng = McapSink(), np.random.default_rng(0)
    sink.open(tmp_path)
    for step in range(8):
        sink.write("log", api.Text("x"), api.Tick(step, step))
        sink.write("camera", api.Image(np.zeros((2, 2), np.uint8), encoded=rng.bytes(600_000)), api.Tick(step, step))
    state = (tmp_path / "run.mcap").read_bytes()
    sink.close()
    assert steps_of(tmp_path / "run.mcap") == list(range(8))
    (tmp_path / "run.mcap").write_bytes(state)
    McapSink().repair(tmp_path)
    assert steps_of(tmp_path / "run.mcap") == steps_of(tmp_path / "run.mcap", "/camera") == list(range(8))
