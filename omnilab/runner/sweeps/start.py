"""How a sweep begins, and how one that was begun before goes on."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf, open_dict, read_write

from omnilab.errors import ConfigError, DataError
from omnilab.runner.config import run_name
from omnilab.runner.overrides.command_line import quoted
from omnilab.runner.run_folder.lock import RunLock, lock_sweep
from omnilab.runner.sweeps.active import ActiveSweep
from omnilab.runner.sweeps.job_log import JOBS
from omnilab.runner.sweeps.optuna_study import go_on, is_optuna, keep_study
from omnilab.runner.sweeps.plan_file import SweepPlan, count, swept

RESUME, RETRY = "resume", "retry_failed"  # words of the command line
ANSWERS = {"true": True, "on": True, "yes": True, "false": False, "off": False, "no": False}


@dataclass(frozen=True)
class Resumption:
    """The sweep that is to go on, and whether jobs that failed are run again."""

    folder: Path
    retry_failed: bool


def resumption(argv: Sequence[str]) -> tuple[list[str], Resumption | None]:
    """The words for Hydra, and what `resume=SWEEP` and `retry_failed=on` say; ConfigError if that cannot be."""
    given = dict(word.split("=", 1) for word in argv if word.startswith((f"{RESUME}=", f"{RETRY}=")))
    rest = [word for word in argv if word.split("=", 1)[0] not in given or "=" not in word]
    retry = given.get(RETRY, "off").lower()
    if retry not in ANSWERS:
        raise ConfigError(f"{RETRY}={given[RETRY]} is neither on nor off; give {RETRY}=on to run failed jobs again")
    if RESUME not in given:
        if given:
            raise ConfigError(f"{RETRY} says how a sweep is resumed; give {RESUME}=SWEEP with it, the sweep's folder")
        return rest, None
    folder = Path(os.path.expanduser(given[RESUME].strip("'\""))).absolute()  # noqa: PTH111  may name no user
    if not (folder / JOBS).is_file():
        raise DataError(
            f"{RESUME}={given[RESUME]}: there is no sweep that could go on (no {JOBS}); omnilab sweep list shows those there are"
        )
    if any(word.startswith("hydra.sweep.dir=") for word in rest):
        raise ConfigError(f"{RESUME}= and hydra.sweep.dir= both name the sweep's folder; leave out hydra.sweep.dir")
    if not {"-m", "--multirun", "hydra.mode=MULTIRUN"} & {*rest}:
        raise ConfigError(f"{RESUME}= is for sweeps; give -m too")
    return [*rest, f"hydra.sweep.dir={quoted(str(folder))}"], Resumption(folder, ANSWERS[retry])


def begun(
    folder: Path, config: DictConfig, command: Sequence[str], resumed: Resumption | None, say: Callable[[str], object]
) -> ActiveSweep:
    """Take the folder, write down what is to be done, and put `SweepLauncher` before the launcher of the configuration.

    DataError if the folder holds another sweep, or one that goes on.
    """
    from omnilab.runner.sweeps.launcher import TARGET

    lock = RunLock.take(folder) if resumed else lock_sweep(folder)
    try:
        launcher, retry = config.hydra.launcher, resumed.retry_failed if resumed else None
        sweep = ActiveSweep(folder.absolute(), lock, launcher, say, retry)
        if is_optuna(config):
            say(keep_study(folder, config))
        sweep.begin(_plan(config, command))
        if resumed and is_optuna(config):
            go_on(config, sweep.load().jobs, resumed.retry_failed)
    except BaseException:
        lock.release()
        raise
    with read_write(config), open_dict(config):
        config.hydra.launcher = {"_target_": TARGET}
    return sweep


def _plan(config: DictConfig, command: Sequence[str]) -> SweepPlan:
    """What the configuration of a sweep comes to."""
    hydra = config.hydra
    sweeper = _plain(hydra.sweeper)
    parameters = swept(_plain(hydra.overrides.task), sweeper.get("params") or {})
    choices = hydra.runtime.choices
    basic = choices["hydra/sweeper"] == "basic"
    jobs = count(parameters) if basic else sweeper.get("n_trials")
    from omnilab import __version__

    return SweepPlan(
        command=[word for word in command if word.partition("=")[0] not in (RESUME, RETRY, "hydra.sweep.dir")],
        directory=str(Path.cwd()),
        experiment=run_name(choices, _plain(hydra.overrides.task)),
        parameters=parameters,
        jobs=jobs,
        launcher=str(choices["hydra/launcher"]),
        sweeper=str(choices["hydra/sweeper"]),
        omnilab=__version__,
    )


def _plain(node: Any) -> Any:
    """A part of the configuration as it is written: nothing is inserted."""
    return OmegaConf.to_container(node, resolve=False)
