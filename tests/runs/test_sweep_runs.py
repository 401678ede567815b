"""Sweeps: what each job and the whole leave behind, and that a job that fails stops no other."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from omnilab.runner.run_folder import load_run

WORLD = Path(__file__).parents[1] / "box_world.yaml"
SENSOR = [f"sensor.world={WORLD}", "sensor.size=96", "sensor.samples=1"]
RADON = ["descriptor.offsets=48", "descriptor.angles=60"]
SMALL = ["experiment=quickstart", "study.query_count=12", "study.show=4", *SENSOR, *RADON]


def summary_of(sweep: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((sweep / "summary.csv").read_text(encoding="utf-8").splitlines()))


@pytest.fixture(scope="module")
def sweep(omnilab_in, tmp_path_factory):
    here = tmp_path_factory.mktemp("sweep")
    result = omnilab_in(here, "-m", *SMALL, "study.step_m=1.0,1.5", "distance=poc,poc_band")
    assert result.rc == 0, result.stderr
    (folder,) = (here / "logs" / "quickstart").iterdir()
    return result, folder


@pytest.mark.slow
def test_a_sweep_has_a_folder_for_each_job(sweep):
    _, folder = sweep
    assert sorted(path.name for path in folder.iterdir() if path.is_dir()) == ["0", "1", "2", "3"]
    for job in "0123":
        assert load_run(folder / job).state == "done"
        assert (folder / job / "run.mcap").exists()
    assert (folder.parents[1] / "latest").resolve() == (folder / "3").resolve()


@pytest.mark.slow
def test_the_summary_holds_overrides_and_metrics_of_each_job(sweep):
    _, folder = sweep
    summary = summary_of(folder)
    assert [(row["study.step_m"], row["distance"]) for row in summary] == [
        ("1.0", "poc"), ("1.0", "poc_band"), ("1.5", "poc"), ("1.5", "poc_band")
    ]  # fmt: skip
    for row in summary:
        assert row["status"] == "done"
        run = load_run(folder / row["job"])
        assert run.config["study"]["step_m"] == float(row["study.step_m"])
        assert run.manifest["components"]["distance"]["name"] == row["distance"]
        assert {name: float(row[name]) for name in run.metrics} == run.metrics
    assert len({row["position_error_mean"] for row in summary}) > 1


@pytest.mark.slow
def test_the_summary_is_printed(sweep):
    result, folder = sweep
    title, header, _, *lines = result.stdout.splitlines()
    assert title == f"logs/quickstart/{folder.name}/summary.csv"
    assert header.split() == ["job", "study.step_m", "distance", "status", "nearest_rate", "second_rate", "wrong_rate"]
    for row, line in zip(summary_of(folder), lines, strict=False):
        printed = [f"{float(row[name]):.6g}" if "_" in name else row[name] for name in header.split()]
        assert line.split() == printed


@pytest.mark.slow
def test_runs_lists_the_jobs_of_a_sweep(sweep, omnilab_here):
    _, folder = sweep
    listed = omnilab_here("runs", str(folder.parents[1])).stdout
    assert all(f"{folder.name}/{job}" in listed for job in "0123")


def test_a_failing_job_does_not_stop_the_others(omnilab_here, tmp_path):
    """One step makes no grid, which is told before the run; at 9 m there is no room, which the run finds out."""
    no_logs = ["~sink@sinks.rerun", "~sink@sinks.mcap"]
    result = omnilab_here("-m", *SMALL, "study.step_m=-1,1.5", "study.height_m=9,1", *no_logs)
    assert result.rc == 1
    assert "Traceback" not in result.stderr
    assert "3 of 4 jobs did not end well" in result.stderr
    (folder,) = (tmp_path / "logs" / "quickstart").iterdir()
    jobs = [load_run(folder / job) for job in "0123"]
    assert [job.state for job in jobs] == ["failed", "failed", "failed", "done"]
    assert "study.step_m=-1 is out of range" in jobs[0].status["error"]
    assert "height 9 m" in jobs[2].status["error"]
    assert "height 9 m" in (jobs[2].folder / "run.log").read_text()
    assert not jobs[2].metrics
    assert [row["status"] for row in summary_of(folder)] == [job.state for job in jobs]
