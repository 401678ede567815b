"""Searches by Optuna: a trial without a value has failed, and a search that was killed goes on to its total."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import warnings

import pytest

from omnilab.runner.sweeps import load_sweep
from omnilab.runner.sweeps.optuna_study import storage_of

pytestmark = pytest.mark.filterwarnings("ignore")  # of SQLAlchemy, about its next version

STUDY = '''
from dataclasses import dataclass

from omnilab import hookimpl
from omnilab.api import Metric, Report


@dataclass
class Parabola:
    """No value below -3."""

    x: float = 0.0
    needs = ()

    def run(self, parts, record, rng):
        return Report([Metric("depth", float("nan") if self.x < -3 else (self.x - 1) ** 2, "1", note="too deep")])


@hookimpl
def register_studies(register):
    register("parabola", Parabola)
'''
RECIPE = "# @package _global_\ndefaults:\n  - override /study: parabola\n"


@pytest.fixture
def search(tmp_path):
    """What begins a search of 20 trials, and what it needs in its environment."""
    (tmp_path / "parabola.py").write_text(STUDY)
    (tmp_path / "recipes" / "experiment").mkdir(parents=True)
    (tmp_path / "recipes" / "experiment" / "parabola.yaml").write_text(RECIPE)
    words = ["--config-dir", "recipes", "-m", "experiment=parabola", "hydra/sweeper=optuna", "hydra.sweeper.n_trials=20",
             "hydra.sweeper.n_jobs=1", "hydra.sweeper.sampler.seed=4", "study.x=interval(-5.0,5.0)",
             "~sinks.rerun", "~sinks.mcap"]  # fmt: skip
    return words, {"OMNILAB_PLUGINS": str(tmp_path / "parabola.py")}


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_search_that_is_killed_at_trial_7_goes_on_to_20(search, omnilab_in, tmp_path):
    import optuna

    words, env = search
    begun = subprocess.Popen(
        [sys.executable, "-m", "omnilab", *words], cwd=tmp_path, env=os.environ | env, stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )  # fmt: skip
    while begun.poll() is None and not list(tmp_path.glob("logs/parabola/*/7/status.json")):
        time.sleep(0.01)
    begun.send_signal(signal.SIGKILL)
    begun.wait()
    (folder,) = (tmp_path / "logs" / "parabola").iterdir()
    before = {job.number: job for job in load_sweep(folder).jobs}
    assert len(before) == 8
    result = omnilab_in(tmp_path, "sweep", "resume", str(folder), "--trust", env=env)  # its recipe is our own
    assert result.rc == 0, result.stderr
    jobs = load_sweep(folder).jobs
    assert [(job.number, job.state) for job in jobs] == [(number, "done") for number in range(20)]
    assert all(jobs[number].overrides == job.overrides for number, job in before.items())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        trials = optuna.load_study(study_name=folder.name, storage=storage_of(folder)).trials
    complete = [trial for trial in trials if trial.state == optuna.trial.TrialState.COMPLETE]
    sensible = [job for job in jobs if float(job.settings["study.x"]) >= -3]
    assert 0 < len(sensible) < 20
    assert sorted(trial.params["study.x"] for trial in complete) == sorted(
        float(j.settings["study.x"]) for j in sensible
    )
    assert all(trial.value == (trial.params["study.x"] - 1) ** 2 for trial in complete)
    assert "study.x" in (folder / "optimization_results.yaml").read_text()
