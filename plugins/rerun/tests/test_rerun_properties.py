"""Which run a recording is of and how it ended, as Rerun's own catalog lists it; and when its records lie on `log_time`."""

from __future__ import annotations

import json
import math
import time

import numpy as np
import pytest
import rerun as rr

from omnilab.api import Metric, Progress, RunResult, Series, Signature, Text, Tick
from omnilab_rerun import RerunSink

MATRIX = Signature(np.ones((2, 2), np.float32))


@pytest.fixture(scope="module")
def columns(tmp_path_factory):
    """The catalog's table of two sweeps with jobs of the same names, and of a run that was cut off: by segment."""
    logs, files = tmp_path_factory.mktemp("logs"), []
    for sweep, job, result in [
        ("first", "0", RunResult("done", [Metric("rate", 0.25, "1"), Metric("error", math.nan, "m")])),
        ("first", "1", RunResult("failed", error="DataError: no room")),
        ("second", "0", None),
    ]:
        folder = logs / sweep / job
        folder.mkdir(parents=True)
        overrides = [f"study.step_m={job}"] if job == "1" else []
        manifest = {
            "id": f"{sweep}{job}",
            "experiment": "grid",
            "overrides": overrides,
            "seed": int(job),
            "identity": "f00",
        }
        (folder / "manifest.json").write_text(json.dumps(manifest))
        sink = RerunSink()
        sink.open(folder)
        sink.write("log", Text("x"), Tick(0, 0))
        if result:
            sink.conclude(result)  # within the tenth of a second in which Rerun gathers what is logged
        sink.close()
        files.append(folder / "run.rrd")
    with rr.server.Server(host="127.0.0.1", datasets={"runs": files}) as server:
        client = server.client()  # which the table needs until it is read
        table = client.get_dataset("runs").segment_table().to_pydict()
    rows = zip(*(values for values in table.values()), strict=True)
    return {row["rerun_segment_id"]: row for row in (dict(zip(table, row, strict=True)) for row in rows)}


def test_every_run_has_a_row_of_its_own(columns):
    assert sorted(columns) == ["first-0-first0", "first-1-first1", "second-0-second0"]
    assert columns["second-0-second0"]["property:RecordingInfo:name"] == ["second/0"]


def test_what_run_it_is_stands_in_columns(columns):
    found = columns["first-1-first1"]
    known = {name: found[f"property:run:{name}"] for name in ("experiment", "overrides", "seed", "identity")}
    assert known == {"experiment": ["grid"], "overrides": ["study.step_m=1"], "seed": [1], "identity": ["f00"]}


def test_how_it_ended_stands_in_columns(columns):
    status = {name: row["property:run:status"] for name, row in columns.items()}
    assert status == {"first-0-first0": ["done"], "first-1-first1": ["failed"], "second-0-second0": ["running"]}
    assert columns["first-1-first1"]["property:run:error"] == ["DataError: no room"]
    done = columns["first-0-first0"]
    assert done["property:metrics:rate"] == [0.25]
    assert math.isnan(done["property:metrics:error"][0])


def test_a_run_without_a_manifest_has_a_number_of_its_own(tmp_path, read):
    names = set()
    for _ in range(2):
        sink = RerunSink()
        sink.open(tmp_path)
        sink.close()
        (entry,) = read(tmp_path / "run.rrd").reader.recordings()
        assert entry.application_id == tmp_path.parent.name
        assert entry.recording_id.startswith(f"{tmp_path.name}-")
        names.add(entry.recording_id)
    assert len(names) == 2


def test_all_of_a_step_lies_at_one_time_on_the_log_time_line(recorded, monkeypatch):
    """A curve that is known when the run ends lies at the images, and one that comes before them, too."""
    clock = iter(range(100, 2000, 100))
    monkeypatch.setattr(time, "time_ns", lambda: next(clock))
    ahead, after = np.array([0, 1]), np.arange(5)
    log = recorded(
        [
            ("progress", Progress("queries", 0, 5), None),
            ("ahead", Series(np.zeros(2), ahead, ahead, "m"), None),
            *[("image", MATRIX, Tick(step, step)) for step in (0, 1, 4)],
            ("other", MATRIX, Tick(4, 4)),
            ("log", Text("x"), Tick(1, 1)),
            ("log", Text("now"), None),
            ("after", Series(np.zeros(5), after, after, "m"), None),
        ]
    )
    assert log.rows("/ahead", "log_time") == [250, 300]
    assert log.rows("/image", "log_time") == [250, 300, 600]
    assert log.rows("/other", "log_time") == [600]
    assert log.rows("/log", "log_time") == [300, 900]
    assert log.rows("/after", "log_time") == [250, 300, 400, 500, 600]
