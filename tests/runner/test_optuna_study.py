"""Optuna's study in a sweep's folder: what an interruption leaves open is settled, and the search goes on to its total."""

from __future__ import annotations

import math
import warnings

import pytest
from omegaconf import OmegaConf

from omnilab.errors import ConfigError, DataError
from omnilab.runner.sweeps.optuna_study import STUDY, go_on, keep_study, storage_of
from omnilab.runner.sweeps.state import Job

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of SQLAlchemy, about its next version
    import optuna

pytestmark = pytest.mark.filterwarnings("ignore")
STATES = optuna.trial.TrialState
LEVEL = {"sensor.noise": optuna.distributions.UniformDistribution(0, 1)}


def configured(**sweeper):
    known = {"storage": None, "study_name": None, "n_trials": 20, "direction": "minimize", "sampler": {"seed": 3}}
    return OmegaConf.create({"objective": None, "hydra": {"sweeper": known | sweeper}})


@pytest.fixture
def cut_off(tmp_path):
    """A sweep of 20 that was killed in trial 7: trials 0 to 4 were told, 5 is done and 6 failed on the disk, untold."""
    config = configured()
    keep_study(tmp_path, config)
    study = optuna.create_study(storage=config.hydra.sweeper.storage, study_name=config.hydra.sweeper.study_name)
    done = []
    for number in range(8):
        trial = study.ask(LEVEL)
        overrides = (f"sensor.noise={trial.params['sensor.noise']}", "experiment=grid")
        if number < 4:
            study.tell(trial, trial.params["sensor.noise"])
        elif number == 4:
            study.tell(trial, state=STATES.FAIL)
        state = {4: "failed", 7: "killed"}.get(number, "done")
        score = math.nan if number == 6 else trial.params["sensor.noise"]
        done.append(Job(number, overrides, tmp_path / str(number), state, metrics={"error": score}))
    return config, done


def found_in(folder):
    return optuna.load_study(storage=storage_of(folder), study_name=folder.name)  # as another process finds it


def test_what_was_interrupted_is_settled_and_tried_again(cut_off, tmp_path):
    config, done = cut_off
    assert go_on(config, done, False) == config.hydra.sweeper.n_trials == 13  # all but 0 to 6
    assert config.hydra.sweeper.sampler.seed == 3 + 9  # the ninth waits
    study = found_in(tmp_path)
    assert [trial.state for trial in study.trials[4:8]] == [STATES.FAIL, STATES.COMPLETE, STATES.FAIL, STATES.FAIL]
    assert study.trials[5].value == study.trials[5].params["sensor.noise"]
    again = study.ask(LEVEL)
    assert again.params == study.trials[7].params
    config.hydra.sweeper.n_trials = 20
    assert go_on(config, done, False) == 13  # killed once more, in that one
    study = found_in(tmp_path)
    assert study.ask(LEVEL).params == again.params
    assert len(study.trials) == 10


def test_failed_trials_are_retried_where_that_is_asked_for(cut_off, tmp_path):
    config, done = cut_off
    assert go_on(config, done, True) == 14
    study = found_in(tmp_path)
    assert [study.ask(LEVEL).params for _ in range(2)] == [study.trials[n].params for n in (4, 7)]


def test_a_study_that_never_began_or_cannot_be_read(tmp_path):
    config = configured()
    keep_study(tmp_path, config)
    assert go_on(config, [], False) == 20
    (tmp_path / STUDY).write_bytes(b"no database" * 100)
    with pytest.raises(DataError, match=r"cannot be read .*move the file away"):
        go_on(config, [], False)


def test_where_the_study_is_kept_and_what_it_looks_for(tmp_path):
    config = configured()
    assert keep_study(tmp_path, config) == "Optuna minimizes the first metric (objective=METRIC names another)"
    assert config.hydra.sweeper.storage == f"sqlite:///{tmp_path / STUDY}"
    own = configured(storage="sqlite:////elsewhere.db", study_name="mine", direction=["minimize", "maximize"])
    own.objective = ["wrong_rate", "nearest_rate"]
    assert keep_study(tmp_path, own) == "Optuna minimizes wrong_rate, maximizes nearest_rate"
    assert (own.hydra.sweeper.storage, own.hydra.sweeper.study_name) == ("sqlite:////elsewhere.db", "mine")
    own.hydra.sweeper.direction = "maximize"
    with pytest.raises(ConfigError, match=r"give hydra.sweeper.direction=\[minimize,minimize\]"):
        keep_study(tmp_path, own)
    with pytest.raises(ConfigError, match=r"has a \? in its name"):
        storage_of(tmp_path / "what?")
