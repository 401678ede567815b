"""Hydra's side: compose a configuration, run it once or as a sweep, and say in one sentence what was wrong with it."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar, cast

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from omnilab.errors import ConfigError, DataError, OmnilabError
from omnilab.runner.boundaries import ending
from omnilab.runner.build import build
from omnilab.runner.config import Run, literal, logs_folder
from omnilab.runner.execute import execute
from omnilab.runner.overrides.command_line import for_hydra, quoted
from omnilab.runner.overrides.compose_errors import sentence
from omnilab.runner.registry import Registry, discover
from omnilab.runner.run_folder import FAILED, RunFolder, load_run, new_folder_name, origin, write_summary
from omnilab.runner.terminal import headline, print_error, print_summary, short, show_run


def experiment(argv: list[str], registry: Registry) -> int:
    """Compose the configuration with Hydra and run it, once or as a sweep. Returns the exit code."""
    OmegaConf.register_new_resolver("omnilab_folder", new_folder_name, use_cache=True, replace=True)
    OmegaConf.register_new_resolver("omnilab_logs", logs_folder, replace=True)
    task = Task(registry)
    os.environ["HYDRA_FULL_ERROR"] = "1"  # exceptions come to us instead of being printed by Hydra
    argv = for_hydra(argv, registry)
    sys.argv = [sys.argv[0], *argv]
    Summary.failed = 0
    try:
        hydra.main(version_base="1.3", config_path="pkg://omnilab.conf", config_name="config")(task)()
    except (HydraException, OmegaConfBaseException) as error:
        raise ConfigError(sentence(error, registry, argv)) from error
    except OSError as error:  # Hydra makes the run's folder
        if error.filename is None:
            raise
        raise DataError(f"{error.filename} cannot be used ({error.strerror}); mend that, or give logs=DIR") from error
    except ValueError as error:
        if "Config group override" not in str(error):
            raise
        raise ConfigError(
            "a slot cannot be set to null; leave a component out with ~SLOT, as in ~descriptor"
        ) from error
    except Exception as error:
        if (mark := getattr(error, "problem_mark", None)) is None:
            raise
        raise ConfigError(f"{mark.name}, line {mark.line + 1}, is no YAML; correct it") from error  # a recipe
    if task.mistake:
        raise task.mistake
    return 1 if Summary.failed else 0


class Task:
    """What Hydra calls for each job. In a worker of a parallel launcher it is a copy, which looks for plugins itself."""

    def __init__(self, registry: Registry | None = None) -> None:
        self.registry = registry
        self.mistake: OmnilabError | None = None

    def __reduce__(self) -> tuple[type[Task], tuple[()]]:
        return Task, ()  # plugins that failed need not pickle

    def __call__(self, config: DictConfig) -> None:
        self.registry = self.registry or discover()
        try:
            run_job(config, self.registry)
        except OmnilabError as mistake:
            self.mistake = mistake  # Hydra would print its own lines about it
        except OmegaConfBaseException as error:
            self.mistake = ConfigError(sentence(error, self.registry))


def run_job(config: DictConfig, registry: Registry) -> None:
    """One job: build, execute, show what came out. In a sweep a failure is noted, and the other jobs go on."""
    state = HydraConfig.get()
    folder = Path(_as_is(state.runtime)["output_dir"])
    overrides = _as_is(state.overrides)["task"]
    name = str(state.runtime.choices.get("experiment"))
    _say_new_names(state.runtime.choices, registry)
    if state.mode is not RunMode.MULTIRUN:
        _run(config, registry, folder, overrides, name)
        show_run(folder)
        return
    print_error(f"job {state.job.num}: {' '.join(overrides)}")
    try:
        _run(config, registry, folder, overrides, name)
        print_error(f"job {state.job.num}: {headline(load_run(folder))}")
    except OmnilabError as mistake:
        _note_failure(folder, overrides, name, mistake)
        print_error(str(mistake))
    except Exception as bug:  # noqa: BLE001  shown in full; the other jobs of the sweep must not pay for it
        _note_failure(folder, overrides, name, bug)
        traceback.print_exc()


def _as_is(node: Any) -> dict[str, Any]:
    """A part of Hydra's own configuration, where a ${ in the name of a folder stands for itself."""
    return cast("dict[str, Any]", OmegaConf.to_container(node, resolve=False, throw_on_missing=False))


def _say_new_names(choices: Mapping[str, Any], registry: Registry) -> None:
    """A line for each component that was chosen by its name of the version before."""
    for group, chosen in choices.items():
        kind = group.partition("@")[0]
        for name in chosen if isinstance(chosen, list) else [chosen]:
            if now := registry.new_name(kind, str(name)):
                print_error(f"{kind} '{name}' is called '{now}' now; write {group}={now}")


def _run(config: DictConfig, registry: Registry, folder: Path, overrides: list[str], name: str) -> None:
    try:
        run = _built(config, registry)
    except OmnilabError:
        if not any(folder.iterdir()):
            folder.rmdir()  # Hydra made it; nothing was run
        raise
    execute(run, folder, registry, overrides, name)


def _built(config: DictConfig, registry: Registry) -> Run:
    """The run; PluginError if a component would end the process while it is made."""
    try:
        return build(config, registry)
    except (Exception, KeyboardInterrupt):
        raise
    except BaseException as error:
        where = traceback.extract_tb(error.__traceback__)[-1].filename
        raise ending(error, f"a component that was being made, in {where},") from error


def _note_failure(folder: Path, overrides: list[str], name: str, error: Exception) -> None:
    """A job that could not even be built leaves a folder that says so."""
    if (folder / "status.json").exists():
        return
    run_folder = RunFolder(folder)
    run_folder.open({"experiment": name, "overrides": overrides, **origin()}, "")
    run_folder.status(FAILED, error=f"{type(error).__name__}: {error}")
    run_folder.close()


class Summary:
    """A Hydra callback: the table over all jobs of a sweep, written and printed when the last has ended."""

    failed: ClassVar[int] = 0  # jobs, of the last sweep

    def on_multirun_start(self, config: DictConfig, **_: Any) -> None:
        """All jobs go into one folder, also where a sweep is over experiments."""
        try:
            folder = quoted(literal(str(config.hydra.sweep.dir)))
        except OmegaConfBaseException:
            return  # Hydra comes upon it next, and what it raises is shown
        config.hydra.overrides.hydra.append(f"hydra.sweep.dir={folder}")

    def on_multirun_end(self, config: DictConfig, **_: Any) -> None:
        folder = Path(config.hydra.sweep.dir)
        header, rows = write_summary(folder)
        if not rows:
            print_error("the sweep has no job: one of its values, such as glob(...), matches nothing; correct that one")
            Summary.failed = 1
            return
        print_summary(header, rows, title=str(short(folder / "summary.csv")))
        Summary.failed = sum(row[header.index("status")] != "done" for row in rows)
        if Summary.failed:
            print_error(f"{Summary.failed} of {len(rows)} jobs did not end well; their status.json says why")

    def __getattr__(self, name: str) -> Callable[..., None]:
        if name.startswith("on_"):  # Hydra calls every event on every callback
            return lambda *_, **__: None
        raise AttributeError(name)
