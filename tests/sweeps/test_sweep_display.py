"""What is shown of a sweep: its table on any terminal, a line for each change elsewhere, and how it stands for others."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import time
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from rich.cells import cell_len
from rich.console import Console

from omnilab.errors import DataError
from omnilab.runner.console_sink import Console as ConsoleSink
from omnilab.runner.run_folder.lock import LockState
from omnilab.runner.run_folder.names import DONE, FAILED, KILLED, RUNNING, SILENT
from omnilab.runner.run_folder.progress import RunProgress
from omnilab.runner.sweeps import display as display_module
from omnilab.runner.sweeps.display import SweepDisplay
from omnilab.runner.sweeps.job_log import PLANNED, log_of
from omnilab.runner.sweeps.plan_file import SweepPlan
from omnilab.runner.sweeps.reader import SweepReader
from omnilab.runner.sweeps.snapshot import Snapshot
from omnilab.runner.sweeps.state import Job, LoadedSweep, load_sweep
from omnilab.runner.sweeps.status_table import advice, board, duration, overall

NOW = datetime(2026, 11, 29, 12, tzinfo=UTC)
HOST = os.uname().nodename
LEADS = LockState(RUNNING, "run", "(process 1), on host here")
STRANGE = "ConfigError: \x1b[31m45\u202e is [bold]no divisor[/bold]; give 漢字漢字漢字漢字漢字漢字漢字漢字漢字漢字漢字漢字漢字漢字"


def at(seconds: float) -> str:
    return (NOW + timedelta(seconds=seconds)).isoformat()


def job(number: int, state: str, began_s: float = -10, ended_s: float = 0, **more: object) -> Job:
    overrides = (f"descriptor.angles={45 * (1 + number % 4)}", f"seed={number // 4}", "experiment=grid")
    times = {} if state == PLANNED else {"started": at(began_s), "host": HOST, "pid": 1}
    times |= {} if state in (PLANNED, RUNNING, SILENT) else {"ended": at(ended_s)}
    metrics = {"nearest_rate": 0.88} if state == DONE else {}
    found = Job(number, overrides, Path(f"/logs/grid/x/{number}"), state, metrics=metrics)
    return replace(found, **times | more)


def seen(
    *jobs: Job, planned: int = 0, launcher: str = "joblib", progress: dict[int, RunProgress] | None = None
) -> Snapshot:
    varied = {"descriptor.angles": ["45", "90"], "seed": ["0", "1"]}
    plan = SweepPlan(["-m", "x=1,2"], "/", "grid", varied, planned or len(jobs), launcher, "basic", "0.1")
    return Snapshot(LoadedSweep(Path("/logs/grid/x"), plan, list(jobs)), progress or {}, LEADS, NOW.timestamp())


# -------------------------------------------------------------------------------------------------------- numbers
def test_the_time_that_is_left_is_that_of_equal_jobs_on_as_many_workers_as_now():
    ended, running = [job(i, DONE, -30, -20) for i in range(3)], [job(i, RUNNING, -4) for i in (3, 4)]
    assert seen(*ended, *running, planned=11).left_s == pytest.approx((2 * 6 + 6 * 10) / 2)
    assert seen(*ended, job(3, RUNNING, -30)).left_s == 0.0  # longer than its like: any moment
    slow = RunProgress("queries", 5, 10, 8.0, written=datetime.now(UTC).isoformat())
    assert seen(*ended, job(3, RUNNING, -30), progress={3: slow}).left_s == pytest.approx(8, abs=0.5)
    assert seen(*running).left_s is None  # nothing was done yet
    assert replace(seen(*ended, planned=9), leader=None).left_s is None  # nothing goes on


@pytest.mark.parametrize("ahead_s", [3600, 1e9])
def test_the_clock_of_another_host_makes_no_time_negative(ahead_s):
    found = seen(job(0, RUNNING, ahead_s), job(1, DONE, ahead_s, 5), job(2, DONE, -10, 0), job(3, RUNNING))
    assert [found.seconds(one) for one in found.sweep.jobs] == [0, 0, 10, 10]
    assert found.left_s >= 0
    assert overall(seen(job(0, DONE), job(1, RUNNING, -20))) == "1 of 2 jobs done, nearly done"
    assert overall(seen(job(0, DONE), job(1, DONE))) == "2 of 2 jobs done"
    assert found.seconds(replace(job(4, DONE), started="yesterday")) is None


@pytest.mark.parametrize(
    ("seconds", "expected"),
    [
        (0, "0.0 s"),
        (9.96, "10 s"),
        (100, "100 s"),
        (120, "2 min"),
        (6000, "100 min"),
        (9000, "2.5 h"),
        (4e5, "4.6 days"),
        (None, ""),
    ],
)
def test_durations_in_words(seconds, expected):
    assert duration(seconds) == expected


# ------------------------------------------------------------------------------------------------------- a terminal
def rendered(found: Snapshot, width: int, height: int, **more: object) -> list[str]:
    console = Console(file=io.StringIO(), width=width, height=height, force_terminal=True, **more)
    console.print(board(found, console))
    return console.file.getvalue().splitlines()


@pytest.mark.parametrize(
    ("width", "height", "count"), [(40, 8, 3), (40, 8, 200), (60, 24, 3), (60, 24, 10_000), (200, 60, 200)]
)
def test_the_table_fits_any_terminal_and_shows_what_matters(width, height, count):
    states = (
        {0: DONE, 1: RUNNING, 2: FAILED} | dict.fromkeys(range(10, 40), RUNNING) | dict.fromkeys(range(50, 99), FAILED)
    )
    jobs = [job(i, states.get(i, PLANNED), error=STRANGE if states.get(i) == FAILED else None) for i in range(count)]
    progress = {1: RunProgress("queries 漢字", 86, 200, 20.0, written=datetime.now(UTC).isoformat())}
    lines = rendered(seen(*jobs, progress=progress), width, height, color_system=None)
    assert len(lines) < height
    assert max(map(cell_len, lines)) <= width
    text = "\n".join(lines)
    assert "\x1b" not in text
    assert "\u202e" not in text
    assert "  1  ang" in text
    assert "43 %" in text
    assert "failed" in text
    assert f"1 of {count} jobs done, {1 if count == 3 else 50} failed" in text
    assert (f"{count - 82} planned" in text) == (count > 3 and width > 40)


def test_no_color_where_none_is_wanted(monkeypatch):
    monkeypatch.setenv("NO_COLOR", "1")
    found = seen(job(0, RUNNING), job(1, FAILED, error="x"))
    assert "\x1b[3" not in "\n".join(rendered(found, 80, 24, color_system="standard"))


# ----------------------------------------------------------------------------------------------------- while it runs
class Sweep:
    """A sweep in memory, of which a display reads."""

    def __init__(self, launcher: str = "joblib", count: int = 3) -> None:
        self.jobs = {i: job(i, PLANNED) for i in range(count)}
        self.launcher, self.error, self.loads, self.takes_s = launcher, None, 0, 0.0

    def load(self) -> LoadedSweep:
        self.loads += 1
        time.sleep(self.takes_s)
        if self.error:
            raise self.error
        return seen(*self.jobs.values(), launcher=self.launcher).sweep

    def set(self, number: int, state: str, **more: object) -> None:
        self.jobs[number] = job(number, state, **more)


@pytest.fixture
def sweep(monkeypatch: pytest.MonkeyPatch) -> Sweep:
    monkeypatch.setattr(display_module, "EVERY_S", 0.02)
    return Sweep()


def looked(sweep: Sweep, times: int = 3) -> None:
    """Until the display has looked so often again."""
    end, wanted = time.monotonic() + 20, sweep.loads + times
    while sweep.loads < wanted:
        assert time.monotonic() < end
        time.sleep(0.01)


def test_without_a_terminal_each_change_is_a_line_once(sweep, capsys):
    display = SweepDisplay(sweep.load)
    sweep.set(0, DONE)
    with display:
        sweep.set(1, RUNNING, host="node\x1b[2J")
        looked(sweep)
        sweep.error = DataError("the disk is slow")  # which is no news
        looked(sweep)
        sweep.error = None
        sweep.set(1, FAILED, ended_s=2, error=STRANGE)
    with display:  # a sweeper hands out jobs batch by batch
        sweep.set(2, DONE)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "omnilab: job 1 (angles=90, seed=0) running on node\\x1b[2J"
    assert lines[1].startswith(
        "omnilab: job 1 (angles=90, seed=0) failed after 12 s: ConfigError: \\x1b[31m45\\u202e is [bold]no"
    )
    assert lines[2:] == ["omnilab: job 2 (angles=135, seed=0) done in 10 s: nearest_rate 0.88"]
    assert not ConsoleSink.quiet


@pytest.mark.parametrize("how", ["well", "interrupted", "bug"])
def test_on_a_terminal_the_table_goes_and_what_failed_stays(sweep, capsys, how):
    console = Console(file=io.StringIO(), width=80, height=24, force_terminal=True)
    display = SweepDisplay(sweep.load, console)
    try:
        with display:
            assert ConsoleSink.quiet
            sweep.set(0, RUNNING)
            looked(sweep)
            sweep.set(0, KILLED, ended_s=1, error="its process died")
            looked(sweep)
            if how == "bug":
                sweep.error = ZeroDivisionError("a bug")
            if how == "interrupted":
                raise KeyboardInterrupt
    except KeyboardInterrupt:
        assert how == "interrupted"
    sweep.error = None
    with display:  # the next batch, which has no news
        looked(sweep)
    out = console.file.getvalue()
    assert "0 of 3 jobs done" in out
    assert out.count("\x1b[?25l") == out.count("\x1b[?25h") == 2  # the cursor is back
    assert capsys.readouterr().err == "omnilab: job 0 (angles=45, seed=0) killed: its process died\n"


def test_jobs_of_this_process_draw_their_own_bars_under_a_line_about_all(sweep, capsys):
    sweep.launcher = "basic"
    with SweepDisplay(sweep.load):
        sweep.set(0, FAILED)
        looked(sweep)
        assert ConsoleSink.heading == "0 of 3 jobs done, 1 failed"
        assert not ConsoleSink.quiet
    assert ConsoleSink.heading == ""
    assert capsys.readouterr().err == ""


def test_a_sweep_that_is_slow_to_read_is_read_less_often(sweep):
    sweep.takes_s = 0.05
    with SweepDisplay(sweep.load):
        time.sleep(0.8)
        assert sweep.loads <= 2


PRINTS = """
import os, subprocess, sys
from pathlib import Path
from omnilab.runner.streams import outlast, printed_into

outlast()
for name, word in (("output/3", "one"), ("output/3", "two"), ("nowhere/output/5", "lost")):
    with printed_into(Path(name + ".log")):
        sys.stdout.write(word)
        os.write(2, b" of a library ")
        subprocess.run(["echo", "of a child"], check=True)
with printed_into(Path("output/4.log")):
    pass
sys.stdout.write("seen")
"""


def test_what_a_worker_prints_is_in_its_file(tmp_path):
    ended = subprocess.run([sys.executable, "-c", PRINTS], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert (ended.stdout, ended.stderr) == ("seen", "")
    text = (tmp_path / "output" / "3.log").read_text()
    assert [text.count(word) for word in ("one", "two", " of a library ", "of a child\n", "lost")] == [1, 1, 2, 2, 0]
    assert [path.name for path in (tmp_path / "output").iterdir()] == ["3.log"]


@pytest.mark.slow
def test_workers_of_joblib_print_nothing_on_the_terminal(omnilab, tmp_path):
    """Neither bars nor lines of theirs: one process speaks."""
    words = ("-m", "~experiment", "study=work", "~sinks.rerun", "~sinks.mcap", "hydra.sweep.dir=s")
    two = ("study.how=well,fail", "study.wait_s=2", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2")
    ended = omnilab(*words, *two, env={"OMNILAB_PLUGINS": str(Path(__file__).with_name("omnilab_jobs.py"))})
    lines = ended.stderr.splitlines()
    assert {line.split(" (")[0] for line in lines[:-1]} <= {"omnilab: job 0", "omnilab: job 1"}
    assert [" done in " in ended.stderr, " failed after " in ended.stderr] == [True, True]
    assert "1 of 2 jobs did not end well" in lines[-1]
    assert "draws" in (tmp_path / "s/output/0.log").read_text()
    assert "told to fail" in (tmp_path / "s/output/1.log").read_text()


# --------------------------------------------------------------------------------------------------------- commands
@pytest.fixture
def on_disk(tmp_path: Path) -> Path:
    """A sweep of four jobs that was cut off."""
    folder = tmp_path / "logs" / "grid" / "mine"
    folder.mkdir(parents=True)
    SweepPlan(["-m", "seed=1,2,3,4"], str(tmp_path), "grid", {"seed": list("1234")}, 4, "joblib", "basic", "0.1").write(
        folder
    )
    log = log_of(folder)
    log.append(*({"event": PLANNED, "job": i, "overrides": [f"seed={i + 1}"]} for i in range(3)))
    log.append({"event": DONE, "job": 0, "metrics": {"nearest_rate": None}})
    log.append({"event": FAILED, "job": 1, "error": "ConfigError: [bold]\x1b[2J"})
    return folder


def test_status_of_a_sweep_that_was_cut_off(on_disk, omnilab_here):
    shown = omnilab_here("sweep", "status", str(on_disk))
    assert shown.rc == 0
    assert "omnilab -m seed=1,2,3,4" in shown.stdout
    assert "  1  seed=2    failed        ConfigError: [bold]\\x1b[2J" in shown.stdout
    assert "and 1 done, 2 planned\n1 of 4 jobs done, 1 failed\n" in shown.stdout
    assert "2 jobs are still to be done, and no process goes on: omnilab sweep resume logs/grid/mine" in shown.stderr
    assert omnilab_here("sweep", "status", str(on_disk), "--watch").stdout == shown.stdout
    found = json.loads(omnilab_here("sweep", "status", str(on_disk), "--json").stdout)
    assert (found["state"], found["total"]) == ("interrupted", 4)
    assert [(one["state"], one["metrics"]) for one in found["jobs"]] == [
        (DONE, {"nearest_rate": None}), (FAILED, {}), (PLANNED, {})
    ]  # fmt: skip


def test_a_reader_reads_what_was_appended_since(on_disk):
    reader, log, file = SweepReader(on_disk), log_of(on_disk), on_disk / "jobs.jsonl"
    assert reader.load() == load_sweep(on_disk)
    log.append({"event": RUNNING, "job": 2}, {"event": DONE, "job": 2, "metrics": {"nearest_rate": 1}})
    assert reader.load() == load_sweep(on_disk)
    assert [one.state for one in reader.load().jobs] == [DONE, FAILED, DONE]
    with file.open("a") as out:
        out.write('{"event": "planned", "job": 3')  # a line that is being written
    assert len(reader.load().jobs) == 3
    with file.open("a") as out:
        out.write(', "overrides": ["seed=4"]}\nno line of ours\n')
    assert reader.load() == load_sweep(on_disk)
    assert (len(reader.load().jobs), reader.load().damaged_lines) == (4, 1)
    file.write_text('{"event": "planned", "job": 0}\n')  # another file
    assert len(reader.load().jobs) == 1
    file.unlink()
    assert reader.load().jobs == []


def test_list_of_sweeps(on_disk, omnilab_here):
    damaged = on_disk.parent / "other"
    damaged.mkdir()
    (damaged / "sweep.yaml").write_text("format: 99\n")
    lines = omnilab_here("sweep", "list").stdout.splitlines()
    assert "interrupted" in lines[2]
    assert "1 failed, 1 done, 2 planned" in lines[2]
    assert "seed (4)" in lines[2]
    assert "unreadable" in lines[3]
    found = json.loads(omnilab_here("sweep", "list", "--json").stdout)
    assert [one["state"] for one in found] == ["interrupted", "unreadable"]
    assert omnilab_here("sweep", "list", "nowhere").rc == 2


def test_no_sweep_to_show(tmp_path, omnilab_here):
    for words, expected in ((["x"], "holds no sweep|there is no folder"), ([], "is no job of a sweep")):
        shown = omnilab_here("sweep", "status", *words)
        assert shown.rc == 2
        assert any(part in shown.stderr for part in expected.split("|"))


def test_a_silent_job_says_what_to_do():
    found = seen(job(0, SILENT, host="node-17"), job(1, DONE))
    (sentence,) = advice(found)
    assert "job 0 is silent" in sentence
    assert (
        "on node-17 cannot be told from here; look there, and if it has ended: omnilab repair --ended /logs/grid/x/0"
        in sentence
    )
