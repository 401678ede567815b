"""Hydra's side: compose a configuration, run it once or as a sweep, and say in one sentence what was wrong with it."""

from __future__ import annotations

import os
import shlex
import sys
import traceback
from collections.abc import Callable, Mapping
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any, ClassVar, cast

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from omnilab.api import Report
from omnilab.errors import ConfigError, DataError, OmnilabError, of_machine
from omnilab.runner.boundaries import ending
from omnilab.runner.build import build
from omnilab.runner.config import Run, literal, logs_folder, run_name
from omnilab.runner.execute import execute
from omnilab.runner.interrupts import HeldSignals
from omnilab.runner.overrides.command_line import for_hydra, quoted
from omnilab.runner.overrides.compose_errors import sentence
from omnilab.runner.overrides.composition import in_sentences
from omnilab.runner.registry import Registry
from omnilab.runner.run_folder import DONE, FAILED, RunFolder, new_folder_name, origin, write_csv
from omnilab.runner.run_folder.names import SUMMARY
from omnilab.runner.shards.words import in_shards
from omnilab.runner.shards.work import JobPlace, shards_of_job
from omnilab.runner.storage.urls import refuse_secrets
from omnilab.runner.streams import printed_into
from omnilab.runner.sweeps.active import ActiveSweep
from omnilab.runner.sweeps.identity import job_identity
from omnilab.runner.sweeps.jobs import JOB, JobLife
from omnilab.runner.sweeps.objective import Value, check_sweep, described, value_of
from omnilab.runner.sweeps.start import Resumption, begun, resumption
from omnilab.runner.sweeps.state import TO_RESUME
from omnilab.runner.sweeps.table import table
from omnilab.runner.sweeps.worker import registry_of_worker, settle
from omnilab.runner.terminal import headline, print_error, print_summary, print_table, short, show_run

OUTPUT = "output"  # the folder in that of a sweep for what jobs print in other processes
IN_SWEEP = (
    "."  # hydra.sweep.subdir, unless it is given: each job's folder is made by the job, so that it may fail alone
)


def experiment(argv: list[str], registry: Registry) -> int:
    """Compose the configuration with Hydra and run it, once or as a sweep, also one that was begun before.

    Returns the exit code.
    """
    if not {f"sensor={c.name}" for c in registry.components.values() if getattr(c.cls, "live", False)} & {*argv}:
        refuse_secrets(argv)  # words are written down, in plans and manifests; an address is the sensor's business
    Sweep.command, (argv, Sweep.resumed) = argv, resumption(in_shards(argv, registry, print_error))
    OmegaConf.register_new_resolver("omnilab_folder", new_folder_name, use_cache=True, replace=True)
    OmegaConf.register_new_resolver("omnilab_logs", logs_folder, replace=True)
    OmegaConf.register_new_resolver("omnilab_name", _name, replace=True)
    task = Task(registry)
    os.environ["HYDRA_FULL_ERROR"] = "1"  # exceptions come to us instead of being printed by Hydra
    argv = for_hydra(argv, registry)
    sys.argv = [sys.argv[0], *argv]
    ActiveSweep.now, all_begun = None, False
    with HeldSignals() as signals:
        try:
            with signals.heard():
                _hydra(task, argv, registry)
            all_begun = True
        finally:  # also when it was interrupted, or a job ended it
            code = _end_sweep(all_begun)
    if task.error:
        raise task.error
    return code


def _hydra(task: Task, argv: list[str], registry: Registry) -> None:
    """Have Hydra call the task, and say in a sentence what it does not like."""
    try:
        with in_sentences(registry, argv):
            hydra.main(version_base="1.3", config_path="pkg://omnilab.conf", config_name="config")(task)()
    except SweepRefusedError as refused:
        raise refused.mistake from refused
    except OSError as error:  # Hydra makes the run's folder
        if error.filename is None:
            raise
        raise DataError(f"{error.filename} cannot be used ({error.strerror}); mend that, or give logs=DIR") from error
    except ValueError as error:
        if "No trials are completed" not in str(error):
            raise
        raise DataError("no trial of the search has an objective; the lines above say why") from error


def _name(*, _root_: DictConfig) -> str:
    return run_name(_root_.hydra.runtime.choices, _as_is(_root_.hydra.overrides)["task"])  # which may hold ${...}


class Task:
    """What Hydra calls for each job. In a worker of a parallel launcher it is a copy, which looks for plugins itself."""

    def __init__(self, registry: Registry | None = None) -> None:
        self.registry, self.is_copy = registry, registry is None  # whose words would mix with those of others
        self.error: Exception | None = None  # which Hydra would print its own lines about

    def __reduce__(self) -> tuple[type[Task], tuple[()]]:
        return Task, ()  # plugins that failed need not pickle

    def __call__(self, config: DictConfig) -> Value | None:
        """Run a job, or the run; what a sweeper is told of a job."""
        if self.registry is None:
            self.registry = registry_of_worker()
        state = HydraConfig.get()
        folder = Path(_as_is(state.runtime)["output_dir"])
        overrides = _as_is(state.overrides)["task"]
        name = run_name(state.runtime.choices, overrides)
        if state.mode is RunMode.MULTIRUN:
            number, subdir = int(state.job.env_set[JOB]), str(state.sweep.subdir)
            sweep = folder if subdir == IN_SWEEP else folder.parents[len(Path(subdir).parts) - 1]
            folder = folder / str(number) if subdir == IN_SWEEP else folder
            life = JobLife(number, folder, sweep, print_error)
            with printed_into(life.sweep / OUTPUT / f"{number}.log") if self.is_copy else nullcontext():
                _say_new_names(state.runtime.choices, self.registry)
                value = run_job(config, self.registry, life, overrides, name)
            if self.is_copy:
                settle()
            return value
        _say_new_names(state.runtime.choices, self.registry)
        try:
            report = _run(config, self.registry, folder, overrides, name, lambda report: show_run(report, folder))
            if config.objective is not None:
                print_error(described(config.objective, value_of(config.objective, _values(report))))
        except Exception as error:  # noqa: BLE001  raised again where Hydra has ended
            self.error = mistake_of(error, self.registry) or error
        return None


def run_job(config: DictConfig, registry: Registry, life: JobLife, overrides: list[str], name: str) -> Value:
    """One job of a sweep: build, execute, show what came out. A failure is noted, and the other jobs go on.

    Returns what a sweeper is told: the objective, or why there is none.
    """
    folder, failure = life.folder, None
    computed: list[Report] = []

    def show(report: Report) -> None:
        computed.append(report)
        print_error(f"job {folder.name}: {headline(_values(report))}")

    print_error(f"job {folder.name}: {' '.join(overrides)}")
    try:
        if not life.begin(lambda: job_identity(_built(config, registry), registry)):
            return "another process runs the job, or has"
        report = _run(config, registry, folder, overrides, name, show, life.sweep)
    except Exception as error:  # noqa: BLE001  bugs are shown in full; the other jobs must not pay for them
        for report in computed:  # which may not be on the disk
            show_run(report, folder)
        failure = mistake_of(error, registry) or error
        _note_failure(folder, overrides, name, failure)
        if isinstance(failure, OmnilabError):
            print_error(str(failure))
        else:
            traceback.print_exception(error)
        return "the job failed"
    finally:
        life.end(overrides, failure)
    try:
        return value_of(config.objective, _values(report))
    except ConfigError as mistake:  # of a study that does not say beforehand which metrics it has
        raise SweepRefusedError(mistake) from mistake


def _values(report: Report) -> dict[str, float]:
    return {metric.name: float(metric.value) for metric in report.metrics}


def mistake_of(error: Exception, registry: Registry) -> OmnilabError | None:
    """The sentence about what is no bug."""
    if isinstance(error, OmnilabError):
        return error
    if isinstance(error, OmegaConfBaseException):
        return ConfigError(sentence(error, registry))
    return of_machine(error)


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


def _run(
    config: DictConfig,
    registry: Registry,
    folder: Path,
    overrides: list[str],
    name: str,
    show: Callable[[Report], object],
    sweep: Path | None = None,
) -> Report:
    try:
        run = _built(config, registry)
        shards = shards_of_job(run, registry, JobPlace(sweep, folder, overrides) if sweep else None)
        return execute(run, folder, registry, overrides, name, show, shards)
    except BaseException:
        with suppress(OSError):  # it holds something, or is not there
            folder.rmdir()  # Hydra made it; nothing was run
        raise


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
    try:
        if (folder / "status.json").exists():
            return
        run_folder = RunFolder(folder)
        run_folder.open({"experiment": name, "overrides": overrides, **origin()}, "")
        run_folder.end(FAILED, error=f"{type(error).__name__}: {error}")
    except (OSError, DataError) as why:
        if str(why) != str(error):
            print_error(str(why))


def _end_sweep(all_begun: bool) -> int:
    """Print and write the table over all jobs that were begun; the exit code. 0 where there is no sweep."""
    sweep, ActiveSweep.now = ActiveSweep.now, None
    if sweep is None:
        return 0
    try:
        return _show_sweep(sweep, all_begun) if sweep.folder.is_dir() else 1
    finally:
        sweep.release()


def _show_sweep(sweep: ActiveSweep, all_begun: bool) -> int:
    found = sweep.load()
    header, rows = table(found.jobs)
    if not rows:
        if all_begun:
            print_error("the sweep has no job: one of its values, such as glob(...), matches nothing; correct that one")
        return 1
    file, failed = sweep.folder / SUMMARY, sum(row[header.index("status")] != DONE for row in rows)
    print_summary(header, rows, title=str(short(file)))
    if failed:
        print_error(
            f"{failed} of {len(rows)} jobs did not end well; the lines above say why, and so does the status.json of each"
        )
    if left := sum(job.state in TO_RESUME for job in found.jobs) + found.unplanned:
        print_error(f"{left} jobs are still to be done: omnilab sweep resume {shlex.quote(str(short(sweep.folder)))}")
    try:
        write_csv(file, header, rows)
    except OSError as error:
        print_table(header, rows, title="the whole table")
        print_error(
            f"{short(file)} cannot be written ({error.strerror}), so the whole table was printed; make room there"
        )
        return 2
    return 1 if failed or left else 0


class SweepRefusedError(BaseException):
    """Ends a sweep, mostly before its first job. Hydra turns every Exception of a callback into a warning."""

    def __init__(self, mistake: OmnilabError) -> None:
        super().__init__(mistake)  # all of it, for a worker's reaches us pickled
        self.mistake = mistake


class Sweep:
    """A Hydra callback that begins a sweep, or goes on with it, and keeps other sweeps from its folder."""

    command: ClassVar[list[str]] = []
    resumed: ClassVar[Resumption | None] = None

    def on_multirun_start(self, config: DictConfig, **_: Any) -> None:
        """All jobs go into one folder, also where a sweep is over experiments, and are launched as `SweepLauncher` does."""
        try:
            literal_folder = literal(str(config.hydra.sweep.dir))
        except OmegaConfBaseException:
            return  # Hydra comes upon it next, and what it raises is shown
        config.hydra.overrides.hydra.append(f"hydra.sweep.dir={quoted(literal_folder)}")
        folder = Path(str(config.hydra.sweep.dir))
        try:
            check_sweep(config)
            folder.mkdir(parents=True, exist_ok=True)
            sweep = begun(folder, config, self.command, self.resumed, print_error)
        except OSError:
            return  # and upon this
        except OmnilabError as mistake:
            raise SweepRefusedError(mistake) from mistake
        ActiveSweep.now = sweep

    def __getattr__(self, name: str) -> Callable[..., None]:
        if name.startswith("on_"):  # Hydra calls every event on every callback
            return lambda *_, **__: None
        raise AttributeError(name)
