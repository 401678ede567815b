"""A worker that dies is one failed job, whichever launcher it is of; the others are run."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace

import pytest
from hydra.core.utils import JobReturn, JobStatus

from omnilab.runner.run_folder.lock import RunLock
from omnilab.runner.sweeps import launcher
from omnilab.runner.sweeps.active import ActiveSweep
from omnilab.runner.sweeps.launcher import SweepLauncher

JOBS = [["a=0"], ["a=1"], ["a=2"], ["a=3"], ["a=4"], ["a=5"]]


class Pool:
    """A launcher of two workers that are lost together, as joblib's are, when a deadly job runs."""

    def __init__(self, sweep: ActiveSweep, deadly: set[int], together: int) -> None:
        self.sweep, self.deadly, self.together, self.launched = sweep, deadly, together, list[list[int]]()

    def launch(self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int) -> list[JobReturn]:
        numbers = [int(words[-1].partition("='")[2][:-1]) for words in job_overrides]
        self.launched.append(numbers)
        for at in range(0, len(numbers), self.together):
            group = numbers[at : at + self.together]
            died = bool(self.deadly & {*group})
            for number in group:
                event = {"event": "killed"} if died else {"event": "done", "metrics": {"m": float(number)}}
                self.sweep.log.append({"job": number, **event})
            if died:
                raise RuntimeError("a worker was lost")
        return [JobReturn(overrides=list(words), status=JobStatus.COMPLETED) for words in job_overrides]


def swept(folder, pool: Pool, sweep: ActiveSweep) -> list[JobReturn]:
    made = SweepLauncher()
    made._sweep, made._inner, made._registry = sweep, pool, None
    made._display = _Quiet()
    made._config = SimpleNamespace(objective="m")
    return list(made.launch(JOBS, 0))


class _Quiet:
    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None


@pytest.fixture
def sweep(tmp_path):
    found = ActiveSweep(tmp_path, RunLock.take(tmp_path), None, lambda sentence: None, None)
    yield found
    found.release()


@pytest.mark.parametrize("together", [1, 2, 3])
@pytest.mark.parametrize("deadly", [set(), {0}, {3}, {5}, {2, 3}, {0, 5}, {0, 1, 2, 3, 4, 5}])
def test_only_the_jobs_that_killed_their_workers_have_failed(sweep, tmp_path, deadly, together, monkeypatch):
    monkeypatch.setattr(launcher, "QUIET_S", 0.0)
    monkeypatch.setattr(launcher, "POLL_S", 0.0)
    pool = Pool(sweep, deadly, together)
    returned = swept(tmp_path, pool, sweep)
    states = {job.number: job.state for job in sweep.load().jobs}
    assert states == {n: "killed" if n in deadly else "done" for n in range(6)}
    assert len(returned) == 6
    for number in deadly:
        assert "its process died (RuntimeError)" in str(sweep.load().jobs[number].error)


def test_a_launcher_that_cannot_begin_is_no_dead_worker(sweep, tmp_path):
    class Broken:
        def launch(self, job_overrides, initial_job_idx):
            raise ValueError("no cluster")

    with pytest.raises(ValueError, match="no cluster"):
        swept(tmp_path, Broken(), sweep)
