"""What the index knows of folders that others write, change, move and remove."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from omnilab_serve.events import Events
from omnilab_serve.index import run_index
from omnilab_serve.index.record_cache import cache_file
from omnilab_serve.index.run_index import RunIndex

CONFIG = "study:\n  step_m: {step_m}\n  show: 1\ndescriptor:\n  angles: 36\nseed: 1\nlogs: logs\n"
HELD = """
import sys, time
from pathlib import Path
from omnilab.runner.run_folder.lock import RunLock
lock = RunLock.take(Path(sys.argv[1]))
print("held", flush=True)
time.sleep(600)
"""


class Heard(Events):
    """Remembers what was published."""

    def __init__(self) -> None:
        super().__init__()
        self.topics: list[str] = []

    def publish(self, *topics: str) -> None:
        self.topics += topics
        super().publish(*topics)


def write_run(folder: Path, state: str = "done", step_m: float = 0.5, rate: float = 0.8) -> None:
    folder.mkdir(parents=True)
    manifest = {
        "experiment": "grid",
        "overrides": [f"study.step_m={step_m}", "experiment=grid"],
        "components": {"descriptor": {"name": "radon"}},
        "host": {"name": "node-17"},
    }
    (folder / "manifest.json").write_text(json.dumps(manifest))
    (folder / "config.yaml").write_text(CONFIG.format(step_m=step_m))
    (folder / "metrics.csv").write_text(f"metric,value,unit,low,high,note\nnearest_rate,{rate},1,0.5,0.9,\n")
    write_status(folder, state)


def write_status(folder: Path, state: str, **more: str) -> None:
    part = folder / "status.part"
    part.write_text(json.dumps({"status": state, "time": "2026-11-29T12:00:10+00:00", "pid": 1, **more}))
    part.replace(folder / "status.json")


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(run_index, "EVERY_S", 0.02)
    monkeypatch.setattr(run_index, "PROCESSOR_SHARE", 1)
    monkeypatch.setattr(run_index, "DISK_SHARE", 1)


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    (tmp_path / "logs").mkdir()
    return tmp_path / "logs"


@pytest.fixture
def index(logs: Path) -> Iterator[Callable[[], RunIndex]]:
    started: list[RunIndex] = []

    def start() -> RunIndex:
        started.append(RunIndex(logs, Heard()))
        started[-1].start()
        return started[-1]

    yield start
    for each in started:
        each.stop()


def until(what: Callable[[], object]) -> None:
    """Wait for something that must come; the time it takes is not the test's business."""
    deadline = time.monotonic() + 60
    while not what():
        assert time.monotonic() < deadline, "it did not come"
        time.sleep(0.01)


def states(index: RunIndex) -> dict[str, str]:
    return {run.path: run.state for run in index.runs()}


def test_a_record_has_what_the_folder_says(logs, index):
    write_run(logs / "grid/2026-11-29_12-00-00-abcdef", step_m=0.25)
    (run,) = index().runs()
    assert (run.path, run.state, run.experiment) == ("grid/2026-11-29_12-00-00-abcdef", "done", "grid")
    assert run.overrides == ("study.step_m=0.25",)
    assert run.settings == {
        "study.step_m": 0.25, "study.show": 1, "descriptor.angles": 36, "seed": 1, "logs": "logs"
    }  # fmt: skip
    assert (run.components, run.host) == ({"descriptor": "radon"}, "node-17")
    assert (run.metrics, run.intervals) == ({"nearest_rate": 0.8}, {"nearest_rate": (0.5, 0.9)})


def test_runs_come_change_and_go(logs, index):
    write_run(logs / "grid/a")
    found = index()
    assert states(found) == {"grid/a": "done"}
    write_run(logs / "grid/b", "failed")
    write_run(logs / "other/deep/c", "interrupted")
    until(lambda: states(found) == {"grid/a": "done", "grid/b": "failed", "other/deep/c": "interrupted"})
    until(lambda: {"runs", "run grid/b", "run other/deep/c"} <= set(found._events.topics))
    shutil.rmtree(logs / "other")
    (logs / "grid/a").rename(logs / "grid/z")
    until(lambda: states(found) == {"grid/z": "done", "grid/b": "failed"})


@pytest.mark.parametrize("error", [OSError("the disk is away"), ValueError("a bug about one run")])
def test_a_look_that_fails_is_said_and_not_the_last(logs, index, monkeypatch, caplog, error):
    monkeypatch.setattr(run_index, "LONGEST_S", 0.02)
    found = index()
    looks = iter([error, error])
    read = found._folders.poll

    def failing(*arguments):
        for each in looks:
            raise each
        return read(*arguments)

    monkeypatch.setattr(found._folders, "poll", failing)
    write_run(logs / "grid/a")
    until(lambda: states(found) == {"grid/a": "done"})
    assert caplog.text.count("could not be looked at") == 2


def test_a_run_that_takes_the_place_of_another_is_read(logs, index):
    write_run(logs / "sweep/0", "interrupted")
    found = index()
    (logs / "sweep/attempts").mkdir()
    (logs / "sweep/0").rename(logs / "sweep/attempts/0")
    write_run(logs / "sweep/0", "done")
    until(lambda: states(found) == {"sweep/0": "done", "sweep/attempts/0": "interrupted"})


def test_a_run_that_is_killed_is_seen_though_no_file_changes(logs, index):
    folder = logs / "grid/a"
    write_run(folder, "running")
    with subprocess.Popen([sys.executable, "-c", HELD, str(folder)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        found = index()
        assert states(found) == {"grid/a": "running"}
        (folder / "progress.json").write_text(
            json.dumps({
                "stage": "queries", "done": 43, "total": 100, "stage_left_s": None, "finished": [], "run_s": 7.5,
                "began": "2026-11-29T12:00:00+00:00", "written": "2026-11-29T12:00:07.5+00:00",
            })
        )  # fmt: skip
        until(lambda: found.runs()[0].progress)
        run = found.run("grid/a")
        assert (run.progress.fraction, run.progress.words, run.seconds) == (0.43, "43 % (queries 43 of 100)", 7.5)
        until(lambda: "run grid/a" in found._events.topics)
        process.send_signal(signal.SIGKILL)
    until(lambda: states(found) == {"grid/a": "killed"})
    assert found.run("grid/a").progress is None


def test_a_sweep_is_found_with_its_runs(finished_runs, logs, index):
    shutil.copytree(finished_runs, logs, dirs_exist_ok=True, symlinks=True)
    found = index()
    until(found.sweeps)
    (sweep,) = found.sweeps()
    assert (sweep.state, sweep.experiment, sweep.counts, sweep.fraction) == ("done", "quickstart", {"done": 2}, 1.0)
    assert sweep.parameters == {"seed": ["3", "4"]}
    assert sorted(run.path for run in found.runs() if run.sweep == sweep.path) == [f"{sweep.path}/0", f"{sweep.path}/1"]
    first = found.search("seed:1").runs[0]
    assert first.seconds > 0
    assert first.started.endswith("+00:00")
    with (logs / sweep.path / "jobs.jsonl").open("a") as out:
        out.write('{"event": "failed", "job": 1, "error": "as if"}\n')
    until(lambda: found.sweeps()[0].counts == {"done": 1, "failed": 1})
    until(lambda: f"sweep {sweep.path}" in found._events.topics)


def test_a_second_start_reads_no_run_again(logs, index, monkeypatch):
    for name in "abc":
        write_run(logs / "grid" / name)
    index().stop()
    (logs / "grid/b/metrics.csv").unlink()  # as nothing that has ended does: to see that it is not read
    write_status(logs / "grid/c", "failed")
    shutil.rmtree(logs / "grid/a")
    found = index()
    assert states(found) == {"grid/b": "done", "grid/c": "failed"}
    assert found.run("grid/b").metrics == {"nearest_rate": 0.8}


@pytest.mark.parametrize("damage", [b"", b"no database at all, but text", None])
def test_the_cache_may_be_damaged_or_gone(logs, index, damage):
    write_run(logs / "grid/a")
    index().stop()
    file = cache_file(logs)
    content = file.read_bytes()
    file.write_bytes(content[:100] + os.urandom(len(content) - 100) if damage is None else damage)
    found = index()
    assert found.run("grid/a").metrics == {"nearest_rate": 0.8}
    found.stop()
    file.unlink()
    assert states(index()) == {"grid/a": "done"}


def test_a_cache_that_cannot_be_written_costs_only_the_next_start(logs, index, monkeypatch):
    write_run(logs / "grid/a")
    monkeypatch.setenv("XDG_CACHE_HOME", "/dev/null/nowhere")
    assert states(index()) == {"grid/a": "done"}


def test_a_damaged_run_hides_no_other(logs, index):
    write_run(logs / "grid/a")
    write_run(logs / "grid/b")
    (logs / "grid/b/manifest.json").write_text('{"experiment": 3}')
    write_run(logs / "grid/c")
    (logs / "grid/c/config.yaml").write_text("a: [*x")
    found = index()
    assert states(found) == {"grid/a": "done", "grid/b": "unreadable", "grid/c": "done"}
    assert "manifest.json cannot be read" in found.run("grid/b").error
    assert found.run("grid/c").settings == {}


@pytest.mark.parametrize(
    "sort", ["nearest_rate", "study.step_m", "step_m", "started", "seconds", "state", "experiment"]
)
def test_an_order_and_its_reverse_have_what_is_missing_last(logs, index, sort):
    for i, name in enumerate(("a", "b", "c")):
        write_run(logs / f"grid/2026-11-29_11-5{i}-00-{name}", step_m=0.5 - i / 10, rate=i / 10)
    (logs / "grid/2026-11-29_11-51-00-b/manifest.json").write_text("")
    found = index()
    up, down = ([run.path[-1] for run in found.search(sort=order).runs] for order in (sort, f"-{sort}"))
    if sort in ("nearest_rate", "started"):
        assert up[:2] == ["a", "c"] if sort == "nearest_rate" else up == ["a", "b", "c"]
    if sort in ("nearest_rate", "study.step_m", "step_m", "seconds", "experiment"):
        assert up[-1] == down[-1] == "b"
    assert sorted(up) == sorted(down) == ["a", "b", "c"]
    assert found.search(sort=sort, offset=1, limit=1).runs[0].path[-1] == up[1]
