"""How far a run has come, on the disk while it goes on."""

from __future__ import annotations

import json
import os
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from omnilab.api import Progress
from omnilab.runner.recorder import ProgressFile, Recorder, progress_file
from omnilab.runner.run_folder import RunFolder, origin
from omnilab.runner.run_folder.progress import RunProgress, read_progress


def written(folder: Path, wanted: str, patience_s: float = 20) -> RunProgress:
    """What stands there once it says so."""
    end = time.monotonic() + patience_s
    while (found := read_progress(folder)) is None or wanted not in found.words:
        assert time.monotonic() < end, found
        time.sleep(0.02)
    return found


def test_it_is_written_while_a_stage_goes_on_and_stays(tmp_path):
    with ProgressFile(tmp_path) as file, Recorder(note=file.note) as record:
        for item in record.track(range(5), "places", 5, lambda _: 1):
            if item == 3:
                assert written(tmp_path, "places").done == 3
        record.log("progress", Progress("queries", 0, 40))
        assert written(tmp_path, "queries").finished == ("places",)
        record.log("progress", Progress("queries", 17, 40))
    last = read_progress(tmp_path)
    assert (last.words, last.fraction, last.finished) == ("42 % (queries 17 of 40)", 0.425, ("places",))
    assert last.began <= last.written
    assert [path.name for path in tmp_path.iterdir()] == ["progress.json"]


@pytest.mark.parametrize("pace_s", [0.5, 4.0])
def test_the_time_that_is_left_by_the_pace_since_the_first_items(tmp_path, monkeypatch, pace_s):
    now_s = iter(
        [0.0, 0.0, 100.0, *(100.0 + pace_s * i for i in range(1, 5)), *[200.0] * 9]
    )  # the first compile for 100 s
    monkeypatch.setattr(progress_file.time, "monotonic", lambda: next(now_s))
    file = ProgressFile(tmp_path)
    for done in range(6):
        file.note(Progress("queries", done, 10))
        assert (file._stage.left_s is None) == (done < 2 or (done - 1) * pace_s < 1)
    assert file._stage.left_s == pytest.approx(5 * pace_s)


def test_what_it_costs(tmp_path, monkeypatch):
    """A thousand times what writing takes passes between two times; a note takes microseconds."""
    writes = []
    monkeypatch.setattr(progress_file, "write_whole", lambda *_: writes.append(time.sleep(0)))
    monkeypatch.setattr(progress_file, "SHARE", 10**9)
    with ProgressFile(tmp_path) as file:
        start_s = time.thread_time()
        for done in range(10_000):
            file.note(Progress(f"stage {done % 50}", done, 10_000))
        assert (time.thread_time() - start_s) / 10_000 < 5e-5
        time.sleep(0.5)
        assert len(writes) <= 1
    assert len(writes) <= 2


@pytest.mark.parametrize("how", ["removed", "full", "odd"])
def test_it_fails_no_run(tmp_path, monkeypatch, how):
    folder = tmp_path / "run"
    folder.mkdir()
    if how == "full":
        monkeypatch.setattr(progress_file, "write_whole", lambda *_: os.close(-1))  # an OSError
    with ProgressFile(folder) as file, Recorder(note=file.note) as record:
        if how == "removed":
            written(folder.parent / "run", "")
            (folder / "progress.json").unlink()
            folder.rmdir()
        for odd in (None, float("nan"), "x", 10**9999, -3):
            record.log("progress", Progress("queries", odd, 7))
    assert how != "odd" or read_progress(folder).done == 0


def test_strangers_files(tmp_path):
    good = json.loads(RunProgress("queries", 1, 2, 3.0, ("a",), 4.0, "b", "c").to_json())
    assert RunProgress.from_json(json.dumps(good)).finished == ("a",)
    for spoilt in (
        {"done": "1"},
        {"done": True},
        {"total": -1},
        {"run_s": float("nan")},
        {"finished": [1]},
        {"stage": None},
    ):
        assert RunProgress.from_json(json.dumps(good | spoilt)) is None
    for text in (b"", b"[]", b"{", b"[" * 10**5, b"\xff"):
        (tmp_path / "progress.json").write_bytes(text)
        assert read_progress(tmp_path) is None
    assert RunProgress("\x1b[31mred", 1, 2).words == "50 % (\\x1b[31mred 1 of 2)"


def test_the_clock_of_another_host():
    """Ahead of ours, it makes nothing longer; behind, an end that should be long over is not known."""
    now = datetime.now(UTC)
    for ahead_s, expected in ((3600, 60.0), (-20, 40.0), (-3600, None)):
        found = RunProgress("queries", 1, 2, 60.0, written=(now + timedelta(seconds=ahead_s)).isoformat()).left_s
        assert found == (expected if expected is None else pytest.approx(expected, abs=2))
    assert RunProgress("queries", 1, 2, 60.0, written="yesterday").left_s is None


def test_the_list_of_runs_says_how_far_one_is(tmp_path, omnilab_here):
    run = RunFolder(tmp_path / "logs" / "now")
    run.open({"experiment": "grid", "overrides": [], **origin()}, "study: {}\n")
    assert "running  " in omnilab_here("runs").stdout
    (run.folder / "progress.json").write_text(RunProgress("queries", 86, 200).to_json())
    assert "running 43 % (queries 86 of 200)" in omnilab_here("runs").stdout
    run.end("failed")
    assert "failed  " in omnilab_here("runs").stdout
