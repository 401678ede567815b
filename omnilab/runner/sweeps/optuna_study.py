"""Optuna's study of a sweep: kept in the sweep's folder, and gone on with after an interruption."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omegaconf import DictConfig, OmegaConf, open_dict, read_write

from omnilab.errors import ConfigError, DataError
from omnilab.runner.config import literal
from omnilab.runner.run_folder.names import DONE, FAILED
from omnilab.runner.sweeps.objective import Value, goals_of, plain, value_of

if TYPE_CHECKING:
    import optuna

    from omnilab.runner.sweeps.state import Job

STUDY = "optuna.db"  # within the sweep's folder
CUT_OFF = "cut_off"  # attribute of a study: the numbers of trials that were interrupted, which do not count
OURS = {"storage", "study_name", "n_trials", "direction"}  # settings of a sweeper that make it Optuna's


def is_optuna(config: DictConfig) -> bool:
    """Whether the sweeper of a configuration is Optuna's."""
    return set(config.hydra.sweeper) >= OURS


def keep_study(folder: Path, config: DictConfig) -> str:
    """Have Optuna keep its study in a sweep's folder, unless another storage is named; what it looks for, in a line.

    ConfigError if it is told another number of directions than of metrics.
    """
    sweeper = config.hydra.sweeper
    objective = plain(config.objective)
    goals = [] if objective is None else goals_of(objective)
    directions = [getattr(one, "name", str(one)) for one in _listed(sweeper.direction)]
    if len(directions) != max(1, len(goals)):
        raise ConfigError(
            f"objective has {max(1, len(goals))} metrics, and hydra.sweeper.direction says of {len(directions)} where to look;"
            f" give hydra.sweeper.direction={_example(len(goals))}"
        )
    with read_write(config), open_dict(config):
        if sweeper.storage is None:
            sweeper.storage = literal(storage_of(folder))
        if sweeper.study_name is None:
            sweeper.study_name = literal(folder.name)
    with _quiet() as optuna:
        optuna.logging.set_verbosity(optuna.logging.WARNING)
    names = [goal.name for goal in goals] or ["the first metric (objective=METRIC names another)"]
    wanted = ", ".join(f"{direction}s {name}" for direction, name in zip(directions, names, strict=True))
    return f"Optuna {wanted}"


def go_on(config: DictConfig, jobs: Sequence[Job], retry_failed: bool) -> int:
    """Have a sweep that was interrupted go on towards its `n_trials`: those that are still to go, which it returns.

    `jobs` are those that it has had. Call `keep_study` first.
    """
    sweeper = config.hydra.sweeper
    ended = {job.overrides: value_of(config.objective, job.metrics) for job in jobs if job.state == DONE}
    if not retry_failed:
        ended |= {job.overrides: "the job failed" for job in jobs if job.state == FAILED}
    to_go, begun = prepare(str(sweeper.storage), str(sweeper.study_name), sweeper.n_trials, ended, retry_failed)
    with read_write(config), open_dict(config):
        sweeper.n_trials = to_go
        if sweeper.sampler.get("seed") is not None:  # which would draw the first trials once more
            sweeper.sampler.seed += begun
    return to_go


def prepare(
    storage: str, name: str, total: int, ended: Mapping[tuple[str, ...], Value], retry_failed: bool = False
) -> tuple[int, int]:
    """Settle what an interruption left open in a study: how many of `total` trials are to go, and how many there were.

    A trial that was going on has its value if its job is among the `ended` ones: what they return, by overrides. Else it
    counts as none, and its parameters are the next to be tried, as are those of failed trials that are to be retried.
    """
    with _quiet() as optuna:
        states = optuna.trial.TrialState
        try:
            study = optuna.load_study(study_name=name, storage=storage)
        except KeyError:  # it was interrupted before its first trial
            return total, 0
        except Exception as error:
            raise DataError(
                f"Optuna's study {storage} cannot be read ({type(error).__name__}); move the file away, and a new one begins"
            ) from error
        cut_off = set(study.user_attrs.get(CUT_OFF, []))
        for trial in study.trials:
            value = _value_of(trial, ended)
            if trial.state == states.RUNNING and value is not None:
                _tell(study, trial.number, value)
            elif trial.state == states.RUNNING or (
                retry_failed and trial.state == states.FAIL and value is None and trial.number not in cut_off
            ):
                _try_again(study, trial, cut_off)
        finished = sum(trial.state.is_finished() and trial.number not in cut_off for trial in study.trials)
        return max(0, total - finished), len(study.trials)


def storage_of(folder: Path) -> str:
    """The address of the study in a sweep's folder; ConfigError if an address cannot hold it."""
    if "?" in str(folder):
        raise ConfigError(f"{folder} has a ? in its name, which addresses of Optuna's studies cannot hold; rename it")
    return f"sqlite:///{folder.absolute() / STUDY}"


def _value_of(trial: optuna.trial.FrozenTrial, ended: Mapping[tuple[str, ...], Value]) -> Value | None:
    """What the job of a trial returned, if it has ended."""
    own = {f"{name}={value}" for name, value in trial.params.items()}
    return next((value for overrides, value in ended.items() if own and own <= {*overrides}), None)


def _tell(study: optuna.Study, number: int, value: Value) -> None:
    import optuna

    if isinstance(value, str):
        study.tell(number, state=optuna.trial.TrialState.FAIL)
    else:
        study.tell(number, value)


def _try_again(study: optuna.Study, trial: optuna.trial.FrozenTrial, cut_off: set[int]) -> None:
    """Have the next trial take a trial's parameters, and its place."""
    cut_off.add(trial.number)
    study.set_user_attr(CUT_OFF, sorted(cut_off))
    if trial.params:  # else it was interrupted before they were chosen
        study.enqueue_trial(trial.params)
    if not trial.state.is_finished():
        _tell(study, trial.number, "interrupted")


@contextmanager
def _quiet() -> Iterator[Any]:
    """Optuna, without what its second version and SQLAlchemy's first say of themselves."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import optuna

        yield optuna


def _listed(direction: Any) -> Sequence[Any]:
    return direction if OmegaConf.is_list(direction) else [direction]


def _example(count: int) -> str:
    return "minimize" if count < 2 else f"[{','.join(['minimize'] * count)}]"
