"""A sweep that was cut off goes on: what is done is taken over, and what is not is run."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnilab.runner.run_folder import load_run
from omnilab.runner.run_folder.lock import RunLock
from omnilab.runner.run_folder.status_file import write_status
from omnilab.runner.sweeps import load_sweep
from omnilab.runner.sweeps.job_log import JOBS, JobLog, read_events

WORDS = "-m", "~experiment", "study=work", "~sinks.rerun", "~sinks.mcap"


def rows(folder: Path = Path("s")) -> list[dict[str, str]]:
    return list(csv.DictReader((folder / "summary.csv").read_text().splitlines()))


def states(folder: Path = Path("s")) -> list[str]:
    return [job.state for job in load_sweep(folder).jobs]


def cut_off(job: int, folder: Path = Path("s")) -> None:
    """Leave a job as a kill does: its folder says that it runs, its lock is nobody's, its last line is missing."""
    (folder / str(job) / "metrics.csv").unlink()
    write_status(folder / str(job), "running")
    lines = (folder / JOBS).read_text().splitlines(keepends=True)
    kept = [line for line in lines if not (json.loads(line).get("job") == job and '"event": "done"' in line)]
    (folder / JOBS).write_text("".join(kept))


def test_what_is_missing_or_was_cut_off_is_run(work, resumed):
    assert work("study.value=1,2,3,4").rc == 0
    before = Path("s/summary.csv").read_bytes()
    kept = (Path("s/0").stat().st_mtime_ns, Path("s/3/metrics.csv").stat().st_mtime_ns)
    cut_off(1)
    shutil.rmtree("s/2")
    lines = Path("s", JOBS).read_text().splitlines(keepends=True)
    Path("s", JOBS).write_text("".join(line for line in lines if not ('"job": 2' in line and "planned" not in line)))
    assert states() == ["done", "killed", "planned", "done"]
    result = resumed()
    assert result.rc == 0, result.stderr
    assert states() == ["done"] * 4
    assert Path("s/summary.csv").read_bytes() == before
    assert kept == (Path("s/0").stat().st_mtime_ns, Path("s/3/metrics.csv").stat().st_mtime_ns)
    assert load_run("s/attempts/1.1").state == "killed", "what a kill has left is kept"
    assert "job 0:" not in result.stderr


@pytest.mark.slow
def test_failed_jobs_are_run_again_when_asked(work, resumed):
    assert work("study.how=well,fail").rc == 1
    assert resumed().rc == 1
    assert not Path("s/attempts").exists()
    assert resumed("--retry-failed").rc == 1
    assert [path.name for path in Path("s/attempts").iterdir()] == ["1.1"]
    assert [row["status"] for row in rows()] == ["done", "failed"]


def test_the_same_command_with_more_values_runs_those(work, omnilab_here):
    work("study.value=1,2")
    first = rows()
    assert omnilab_here(*WORDS, "study.value=3,1,2", "resume=s").rc == 0
    assert [row["study.value"] for row in rows()] == ["1", "2", "3"]
    assert rows()[:2] == first


@pytest.mark.slow
def test_a_job_of_another_version_is_run_again(work, resumed):
    work("study.value=1,2")
    log = Path("s", JOBS)
    events = [json.loads(line) for line in log.read_text().splitlines()]
    for event in events:
        if event["event"] == "done" and event["job"] == 1:
            event["identity"] = "0" * 64
    log.write_text("".join(json.dumps(event) + "\n" for event in events))
    manifest = json.loads(Path("s/1/manifest.json").read_text())
    Path("s/1/manifest.json").write_text(json.dumps(manifest | {"identity": "0" * 64}))
    result = resumed()
    assert "job 1 was done with other versions, settings or files, and is run again" in result.stderr
    assert Path("s/attempts/1.1/metrics.csv").read_bytes() == Path("s/1/metrics.csv").read_bytes()


@pytest.mark.slow
def test_two_processes_do_not_resume_the_same_sweep(work, resumed):
    work("study.value=1")
    with RunLock.take(Path("s")):
        result = resumed()
    assert (result.rc, result.stdout) == (2, "")
    assert "s is still running (process" in result.stderr


def test_what_cannot_be_resumed_is_said(work, omnilab_here):
    work("study.value=1")
    for words, says in (
        (["resume=nowhere"], "there is no sweep that could go on"),
        (["retry_failed=on"], "give resume=SWEEP with it"),
        (["resume=s", "retry_failed=maybe"], "neither on nor off"),
        (["resume=s", "hydra.sweep.dir=t"], "both name the sweep's folder"),
    ):
        result = omnilab_here(*WORDS, *words)
        assert (result.rc, says in result.stderr) == (2, True), result.stderr


def test_a_strangers_plan_inserts_and_executes_nothing(work, resumed, monkeypatch):
    work("study.value=1")
    monkeypatch.setenv("SECRET", "abc")
    plan = Path("s/sweep.yaml")
    own = plan.read_text()
    words = [
        "study.mark=${oc.env:SECRET}", "hydra.launcher._target_=os.system", "hydra.job.env_set.A=1", "--config-dir=/x",
        "hydra={launcher:{_target_:os.system}}", "descriptor=../../../tmp/evil", "+sink@hydra.launcher=console",
        "logs=/somewhere", "++cache=../up", "study.folder='~/.config'",
    ]  # fmt: skip
    for word in words:
        plan.write_text(own.replace("- study=work", f"- study=work\n- {json.dumps(word)}"))
        result = resumed()
        assert (result.rc, word in result.stderr) == (2, True)
        assert "abc" not in result.stderr


def test_a_damaged_plan_is_said(work, resumed):
    work("study.value=1")
    for text in "", "[]", "format: 99", "a: *b", "command: 3\nformat: 1", "x" * 100 + ": {":
        Path("s/sweep.yaml").write_text(text)
        result = resumed()
        assert (result.rc, "sweep.yaml" in result.stderr) == (2, True), text
    assert "Traceback" not in result.stderr


@given(cut=st.integers(0, 200), garbage=st.binary(max_size=40))
def test_a_torn_line_costs_itself_alone(tmp_path_factory, cut, garbage):
    folder = tmp_path_factory.mktemp("log")
    log = JobLog(folder)
    log.append({"event": "planned", "job": 0, "overrides": ["a=1"]}, {"event": "planned", "job": 1, "overrides": []})
    whole = (folder / JOBS).read_bytes()
    kept = whole[: len(whole) - min(cut, len(whole))]
    (folder / JOBS).write_bytes(kept + garbage)
    log.append({"event": "done", "job": 1, "metrics": {"m": 1.0}})
    events, _ = read_events(folder)
    assert events[-1]["event"] == "done"
    assert [event["job"] for event in events if event["event"] == "planned"][: kept.count(b"\n")] == list(
        range(kept.count(b"\n"))
    )


def test_the_identity_is_of_what_results_depend_on(work, omnilab_here):
    work("study.value=1,2", "seed=3,4")
    ids = [job.identity for job in load_sweep("s").jobs]
    assert len(set(ids)) == 4
    omnilab_here(
        *WORDS[1:], "study.value=1", "seed=3", "hydra.run.dir=elsewhere/r", "logs=other", "limits=off", "cache=off"
    )
    assert load_run("elsewhere/r").manifest["identity"] == ids[0]
