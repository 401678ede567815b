"""The page of a sweep: its jobs as they stand, while it goes on, after it was killed, and when it has gone on."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from omnilab.client import JobRecord, SweepRecord
from omnilab.runner.sweeps import load_sweep
from omnilab_serve.sweeps import WatchedSweeps
from omnilab_serve.sweeps.grid import failures, job_grid, sorted_jobs

RUN = [
    "experiment=quickstart", "study.query_count=6", "study.step_m=1.0", "sensor.size=64", "sensor.samples=1", "descriptor=hog",
    "~sinks.rerun", "~sinks.mcap", "cache=off",
]  # fmt: skip


def job(number, state="done", error=None, seconds=None, **settings):
    metrics = {"rate": settings.pop("rate")} if "rate" in settings else {}
    overrides = [f"{name}={value}" for name, value in settings.items()]
    return JobRecord(number, state, overrides, f"s/{number}", metrics, error, seconds)


def sweep(*jobs, **parameters):
    return SweepRecord("s", "running", parameters=parameters, jobs=jobs)


def numbers(cells):
    return [cell.job.number for cell in cells]


def test_two_settings_span_a_grid_in_which_seeds_share_a_cell():
    jobs = [
        job(i, a=a, b=b, seed=seed)
        for i, (a, b, seed) in enumerate((a, b, seed) for a in (10, 9, 8) for b in ("x", "y") for seed in (1, 2))
    ]
    grid = job_grid(sweep(*jobs, a=["10", "9", "8"], b=["x", "y"], seed=["1", "2"]))
    assert (grid.across, grid.down, grid.columns) == ("a", "b", ["8", "9", "10"])
    assert [(value, [numbers(cell) for cell in cells]) for value, cells in grid.rows] == [
        ("x", [[8, 9], [4, 5], [0, 1]]),
        ("y", [[10, 11], [6, 7], [2, 3]]),
    ]


def test_one_setting_is_a_row_and_three_are_a_list():
    grid = job_grid(sweep(job(0, a=1), job(1, a=2), a=["1", "2"]))
    assert (grid.across, grid.down, [numbers(cell) for cell in grid.rows[0][1]]) == ("a", "", [[0], [1]])
    seeds = job_grid(sweep(job(0, seed=1), job(1, seed=2), seed=["1", "2"]))
    assert seeds.across == "seed"
    many = job_grid(sweep(job(0, a=1, b=1, c=1), job(1, a=2, b=2, c=2), a=["1", "2"], b=["1", "2"], c=["1", "2"]))
    assert (many.across, numbers(many.rows[0][1][0])) == ("", [0, 1])
    assert job_grid(sweep(a=["1", "2"])).across == ""


def test_a_metric_colours_from_its_smallest_to_its_largest_value():
    grid = job_grid(
        sweep(*(job(i, a=i, rate=i / 10) for i in range(11)), job(11, "failed", a=11), a=list(map(str, range(12)))),
        "rate",
    )
    cells = [cell for column in grid.rows[0][1] for cell in column]
    assert [cell.level for cell in cells] == [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, None]
    assert (grid.low, grid.high) == (0.0, 1.0)
    assert cells[3].words == "0.3"
    assert "job 3 (a=3), done, rate 0.3" in cells[3].tip


def test_jobs_that_ended_badly_come_first_and_any_column_sorts():
    jobs = [job(0, rate=0.5, a=10), job(1, "planned", a=9), job(2, "failed", "E", a=8), job(3, "running", a=7),
            job(4, rate=0.9, a=11)]  # fmt: skip
    assert [found.number for found in sorted_jobs(jobs, "")] == [2, 3, 0, 4, 1]
    assert [found.number for found in sorted_jobs(jobs, "-rate")][:2] == [4, 0]
    assert [found.number for found in sorted_jobs(jobs, "rate")][:2] == [0, 4]
    assert [found.number for found in sorted_jobs(jobs, "a")] == [3, 2, 1, 0, 4]
    assert [found.number for found in sorted_jobs(jobs, "-job")] == [4, 3, 2, 1, 0]


def test_failures_of_one_reason_are_one():
    jobs = [job(0, "failed", "A"), job(1, "failed", "B"), job(2, "killed", "B"), job(3)]
    assert [(error, [one.number for one in found]) for error, found in failures(jobs)] == [("B", [1, 2]), ("A", [0])]


def test_the_reader_of_a_watched_sweep_is_kept(finished_runs, tmp_path):
    folder = next(path.parent for path in finished_runs.glob("quickstart/*/jobs.jsonl"))
    copy = Path(shutil.copytree(folder, tmp_path / "sweep"))
    watched = WatchedSweeps()
    assert watched.snapshot(copy).sweep.counts == {"done": 2}
    with (copy / "jobs.jsonl").open("a") as log:
        log.write('{"event": "planned", "job": 2, "overrides": ["seed=9"], "time": "2026-11-29T21:00:00+00:00"}\n')
    assert watched.snapshot(copy).sweep.counts == {"done": 2, "planned": 1}


def test_the_api_says_what_the_folder_says(serve, finished_runs):
    folder = next(path.parent for path in finished_runs.glob("quickstart/*/jobs.jsonl"))
    path = folder.relative_to(finished_runs).as_posix()
    served = serve(logs=finished_runs)
    found = served.client.get(f"/api/sweeps/{path}").json()
    assert (found["path"], found["state"], found["counts"]) == (path, "done", {"done": 2})
    own = load_sweep(folder)
    assert [one["metrics"]["nearest_rate"] for one in found["jobs"]] == [j.metrics["nearest_rate"] for j in own.jobs]
    assert [one["path"] for one in found["jobs"]] == [f"{path}/0", f"{path}/1"]
    compared = served.client.get("/api/compare", params={"run": path}, timeout=120).json()
    assert [run["path"] for run in compared["runs"]] == [f"{path}/0", f"{path}/1"]
    for address in ("/api/sweeps/none", "/api/compare?run=none", "/sweeps/none", "/sweeps/../x"):
        assert served.client.get(address).status_code == 404
    assert served.client.get("/api/compare").status_code == 422


def test_hostile_texts_of_a_sweep_are_no_markup(serve, tab, tmp_path):
    folder = tmp_path / "logs" / "grid" / "<b>&'"
    folder.mkdir(parents=True)
    evil = "<script>document.title='taken'</script>"
    (folder / "sweep.yaml").write_text(
        f"format: 1\ncommand: ['{evil.replace(chr(39), '')}']\ndirectory: /\nexperiment: \"{evil}\"\nparameters: {{\"{evil}\": ['1', '2']}}\n"
        "jobs: 2\nlauncher: basic\nsweeper: basic\nomnilab: 0.1.0\ntime: x\n"
    )
    (folder / "jobs.jsonl").write_text(
        f'{{"event": "planned", "job": 0, "overrides": ["{evil}=1"], "time": "x"}}\n'
        f'{{"event": "running", "job": 0, "folder": "0", "time": "x"}}\n'
        f'{{"event": "failed", "job": 0, "error": "{evil}", "metrics": {{"{evil}": 1}}, "time": "x"}}\n'
    )
    served = serve(logs=tmp_path / "logs")
    tab.goto(f"{served.url}/sweeps/grid/%3Cb%3E%26'")
    assert evil in tab.locator("h1").inner_text()
    assert "taken" not in tab.title().replace(evil, "")
    assert tab.locator("main script, main b").count() == 0


@pytest.mark.slow
def test_a_killed_sweep_shows_its_states_and_goes_on(serve, tab, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # a sweep goes on from where it was begun
    logs = tmp_path / "logs"
    served = serve(logs=logs)
    leader = subprocess.Popen(
        [sys.executable, "-m", "omnilab", "-m", *RUN, "seed=1,2"], start_new_session=True, stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        while not (found := list(logs.glob("quickstart/*/1/progress.json"))):
            assert leader.poll() is None
            time.sleep(0.02)
        os.killpg(leader.pid, signal.SIGSTOP)  # it goes on for as long as is looked at
        folder = found[0].parent.parent
        tab.goto(f"{served.url}/sweeps/{folder.relative_to(logs).as_posix()}")
        tab.locator("#grid .job.running").wait_for(timeout=30_000)
        assert tab.locator("#grid .job").count() == 2
        assert tab.locator("button", has_text="Stop").is_visible()
    finally:
        os.killpg(leader.pid, signal.SIGKILL)
        leader.wait()
    tab.locator("h1 .state.interrupted").wait_for(timeout=60_000)
    states = [re.findall(r"job (\w+)", one.get_attribute("class"))[0] for one in tab.locator("#grid .job").all()]
    counts = load_sweep(folder).counts
    assert {state: states.count(state) for state in set(states)} == counts
    assert counts["killed"] == 1
    tab.get_by_role("button", name="Resume", exact=True).click()
    tab.locator("#sweep-answer", has_text="It is in the queue").wait_for(timeout=20_000)
    tab.locator("h1 .state.done").wait_for(timeout=150_000)
    assert load_sweep(folder).counts == {"done": 2}
    tab.locator("#comparison #metrics").wait_for(timeout=120_000)
