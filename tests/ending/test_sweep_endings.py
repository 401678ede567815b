"""A sweep goes on whatever becomes of one job, and writes its table however it ends."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import pytest

from omnilab.runner.run_folder import load_run


def rare(how: str) -> Any:
    """Of a sweep as of a run, whose tests try all of them."""
    return pytest.param(how, marks=pytest.mark.slow)


def rows_of(tmp_path: Path) -> list[dict[str, str]]:
    (sweep,) = (tmp_path / "logs" / "pose_graph").iterdir()
    return list(csv.DictReader((sweep / "summary.csv").read_text().splitlines()))


@pytest.mark.parametrize("how", ["bug", "exit", *(rare(how) for how in ("recursion", "unspeakable", "memory", "full"))])
def test_a_job_that_does_not_end_well(endings, tmp_path, how):
    result = endings("-m", f"study.how=well,{how},SIGCONT")
    assert result.rc == 1
    assert [row["status"] for row in rows_of(tmp_path)] == ["done", "failed", "done"]
    assert "1 of 3 jobs did not end well" in result.stderr


@pytest.mark.parametrize("how", ["SIGTERM", *(rare(how) for how in ("SIGINT", "SIGHUP", "twice"))])
def test_a_signal_ends_the_sweep_with_its_table(endings, tmp_path, how):
    result = endings("-m", f"study.how=well,{how},SIGCONT")
    assert result.rc == 130
    assert [row["status"] for row in rows_of(tmp_path)] == ["done", "interrupted"]
    assert "summary.csv" in result.stdout


def test_a_signal_while_results_are_written_ends_the_sweep_after_them(endings, tmp_path):
    result = endings("-m", "study.saving='',SIGINT,''")
    assert result.rc == 130
    assert [row["status"] for row in rows_of(tmp_path)] == ["done", "done"]


def test_a_job_whose_folder_cannot_be_made(endings, tmp_path, monkeypatch):
    """Somebody's file lies there."""
    sweep = tmp_path / "logs" / "pose_graph" / "mine"
    sweep.mkdir(parents=True)
    (sweep / "1").write_text("a note")
    result = endings("-m", "study.value=1,2,3", f"hydra.sweep.dir={sweep}")
    assert result.rc == 1
    assert "Traceback" not in result.stderr
    assert [(row["status"], row["study.value"], row["precious"]) for row in rows_of(tmp_path)] == [
        ("done", "1", "1"), ("failed", "2", ""), ("done", "3", "3")
    ]  # fmt: skip
    assert (sweep / "1").read_text() == "a note"


def test_a_job_with_a_setting_that_cannot_be_inserted(endings, tmp_path):
    result = endings("-m", "seed=1,${nowhere},3", "study.value=2")
    assert "Traceback" not in result.stderr
    assert result.rc in {1, 2}
    assert "nowhere" in result.stderr


def test_a_folder_for_each_job_as_hydra_would_name_it(endings, tmp_path):
    result = endings("-m", "seed=1,2", "hydra.sweep.subdir='job-${hydra:job.num}'")
    assert result.rc == 0
    (sweep,) = (tmp_path / "logs" / "pose_graph").iterdir()
    assert sorted(path.name for path in sweep.iterdir() if path.is_dir()) == ["job-0", "job-1"]
    assert load_run(sweep / "job-1").state == "done"
    assert [row["seed"] for row in rows_of(tmp_path)] == ["1", "2"]
