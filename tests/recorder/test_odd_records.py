"""Records that logs have no form for, and paths that are no names: they cost themselves, neither sink nor run."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rerun.chunk import RrdReader

from omnilab.api import Graph, PlaceMap, Record, Text, Tick
from omnilab.runner.recorder import Recorder
from omnilab.testing import sample_records
from omnilab_mcap import McapSink
from omnilab_rerun import RerunSink

PATHS = [
    "",
    "/",
    "//x//y/",
    "..",
    "a b/ü!",
    "a\\b",
    "a\nb",
    "\x00",
    "\ud800",
    "x" * 3000,
    "a:b?c",
    "\x1b[31m",
    "[x]",
    "日本",
]
NUMBERS = [np.nan, np.inf, 1e300, -1]


def odd(record: Record) -> Iterator[Record]:
    """The record with one of its fields gone wrong."""
    for field in fields(record):
        value = getattr(record, field.name)
        changed: list[object] = []
        if isinstance(value, np.ndarray):
            changed += [value[:0], np.zeros(()), None, value.astype(object)]
            for number in NUMBERS if value.dtype.kind == "f" else [-1, 10**9] if value.dtype.kind == "i" else []:
                changed.append(value.astype(float) if value.dtype.kind == "f" else value.copy())
                changed[-1].flat[0] = number
        elif isinstance(value, str):
            changed += ["", "\x00", "\ud800", "unknown", "\x1b[31m"]
        elif isinstance(value, float):
            changed += NUMBERS
        yield from (replace(record, **{field.name: one}) for one in changed)


@pytest.mark.parametrize("name", ["mcap", "rerun"])
def test_what_a_log_cannot_hold_is_left_out(tmp_path, caplog, name):
    sink = McapSink() if name == "mcap" else RerunSink()
    step = 0
    with warnings.catch_warnings(action="error"), Recorder({name: sink}, tmp_path) as recorder:
        for path, record, tick in sample_records():
            for one in odd(record):
                recorder.log(f"{path}/{step}", one, tick and Tick(step, step))
                recorder.log("log", Text("as it should be"), Tick(step, step))
                step += 1
        for path in PATHS:
            recorder.log(path, Text("under an odd path"), Tick(step, step))
            recorder.log("log", Text("as it should be"), Tick(step, step))
            step += 1
    assert recorder.dropped == {}
    assert step > 100
    assert caplog.text.count(f"sink '{name}' cannot take the record") == 1
    assert f"sink '{name}' has left out" in caplog.text
    assert sink.repair(tmp_path) is None
    assert lines_in(tmp_path, name) == list(range(step))


def lines_in(folder: Path, name: str) -> list[int]:
    if name == "mcap":
        with (folder / "run.mcap").open("rb") as file:
            found = make_reader(file, validate_crcs=True).iter_messages(topics="/log")
            return sorted(message.sequence for _, _, message in found)
    chunks = [chunk for chunk in RrdReader(folder / "run.rrd").stream().to_chunks() if chunk.entity_path == "/log"]
    return sorted(step for chunk in chunks for step in chunk.to_record_batch().column("step").cast("int64").to_pylist())


@pytest.mark.parametrize("tick", [None, Tick(0, 0)])
def test_what_is_empty_is_no_mistake(tmp_path, caplog, tick):
    none, edges = np.zeros((0, 3)), np.zeros((0, 2), int)
    with Recorder({"mcap": McapSink(), "rerun": RerunSink()}, tmp_path) as recorder:
        recorder.log("graph", Graph(np.zeros((1, 3)), edges), tick)
        recorder.log("no graph", Graph(none, edges), tick)
        recorder.log("places", PlaceMap(none), tick)
        recorder.log("turned places", PlaceMap(none, np.zeros(0)), tick)
        recorder.log("text", Text(""), tick)
    assert caplog.text == ""
