"""Executes a run: its folder, its recorder, its threads, its signals; its results, whatever happens."""

from __future__ import annotations

import hashlib
import logging
import os
import resource
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from traceback import format_exc
from typing import Any

import numpy as np
from omegaconf import OmegaConf

from omnilab.api import KINDS, Parts, Progress, Report, RunResult, Shards, Text, is_cached
from omnilab.errors import OmnilabError, of_machine
from omnilab.hooks import Accelerator
from omnilab.limits import limited
from omnilab.manifest import new_id, read_manifest
from omnilab.memory import keep_freed
from omnilab.runner.boundaries import SpotCheck, check_report, ending, guard
from omnilab.runner.cache import DiskCache
from omnilab.runner.config import Run, cache_folder, resolved, resolved_yaml
from omnilab.runner.console_sink import Console
from omnilab.runner.devices import on_device, open_device, placed_components, say_what_stays
from omnilab.runner.input_files import file_digests
from omnilab.runner.interrupts import HeldSignals
from omnilab.runner.map_file import FILE, load_places, save_map
from omnilab.runner.recorder import ProgressFile, Recorder
from omnilab.runner.registry import Registry
from omnilab.runner.run_folder import DONE, FAILED, INTERRUPTED, WARNINGS, RunFolder, origin
from omnilab.runner.shards.work import ShareDone
from omnilab.runner.sweeps.identity import job_identity

SHOWN = 3  # warnings above a summary
RESULTS = "results"  # the last stage: they are being written

Named = dict[str, dict[str, str]]  # by slot: what a component is, and where it is computed

log = logging.getLogger("omnilab")


def execute(
    run: Run,
    folder: Path,
    registry: Registry,
    overrides: Sequence[str] = (),
    experiment: str = "",
    show: Callable[[Report], object] = lambda _: None,
    shards: Shards | None = None,
) -> Report:
    """Run the study, and leave a complete run folder whatever happens; results are shown before they are written.

    `shards`: the share of the work that is done; None: all.
    """
    config_yaml = resolved_yaml(run)
    accelerator = open_device(run.device, registry)
    named = placed_components(run, registry, accelerator)
    manifest = manifest_of(run, registry, overrides, experiment, config_yaml, named)
    keep_freed()
    with HeldSignals() as signals:
        run_folder = RunFolder(folder)
        run_folder.open(manifest, config_yaml, Path(run.logs) / "latest")
        progress, cache, start = ProgressFile(folder), None, time.perf_counter()
        recorder = Recorder(run.sinks, folder, progress.note, read_manifest(folder))
        last_status: dict[str, Any] = {"status": INTERRUPTED}
        log.info("run of experiment '%s' starts: %s", experiment, " ".join(overrides))
        say_what_stays(run, named)
        try:
            cache = _cache(run)
            try:
                logs = _concluded(recorder, run_folder)
                with progress, pinned(run.threads), signals.heard(recorder.interrupt), recorder, logs:
                    with limited(run.limits):
                        parts = _parts(run, registry, cache, shards or Shards(), accelerator)
                        report = _studied(run, parts, registry, recorder)
                    recorder.result = RunResult(DONE, report.metrics)
                    with signals.held():
                        progress.note(Progress(RESULTS, 0, 0))
                        _write(report, run, named, run_folder, recorder, show)
                        if not run_folder.missing:
                            last_status = {"status": DONE}
            finally:
                run_folder.write_costs(_costs(recorder, cache, time.perf_counter() - start))
            run_folder.check()
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            last_status = {"status": FAILED, "error": _message(error)}
            log.error("the run failed: %s", _message(error), exc_info=not isinstance(error, OmnilabError))
            if mistake := of_machine(error):
                raise mistake from error
            if not isinstance(error, Exception):
                raise ending(error, registry.title_of("study", run.study)) from error
            raise
        finally:
            log.info("%s in %.1f s", last_status["status"], time.perf_counter() - start)
            run_folder.end(**last_status, sinks_dropped=recorder.dropped)
    return report


@contextmanager
def _concluded(recorder: Recorder, run_folder: RunFolder) -> Iterator[None]:
    """The recorder knows how the run ended, and with which metrics, before it closes the logs."""
    status, error, where = INTERRUPTED, "", ""
    try:
        yield
        if run_folder.missing:
            status, error = FAILED, f"{', '.join(run_folder.missing)} could not be written"
        else:
            status = DONE
    except KeyboardInterrupt:
        raise
    except BaseException as mistake:
        status, error = FAILED, _message(mistake)
        where = "" if isinstance(mistake, OmnilabError) else format_exc()
        raise
    finally:
        metrics = recorder.result.metrics if recorder.result else ()
        recorder.result = RunResult(status, metrics, error, where)


def _studied(run: Run, parts: Parts, registry: Registry, recorder: Recorder) -> Report:
    """What the study found, checked and logged."""
    for failure in registry.failures:
        log.info("%s", failure.sentence)  # the command line has printed it
    try:
        report: Report = run.study.run(parts, recorder, np.random.default_rng(run.seed))
    except ShareDone as done:
        report = done.report
    check_report(report, registry.title_of("study", run.study))
    _log_results(report, recorder)
    return report


def _write(
    report: Report,
    run: Run,
    named: Named,
    run_folder: RunFolder,
    recorder: Recorder,
    show: Callable[[Report], object],
) -> None:
    """Show the results, then write all of them that can be written."""
    for sink in run.sinks.values():
        if isinstance(sink, Console):
            sink.leave_terminal()
    places = report.map
    others = {} if places is None else {FILE: lambda: save_map(run_folder.folder / FILE, places, _about(run, named))}
    try:
        show(report)
    finally:
        run_folder.write(report, recorder.warnings, others)


def _message(error: BaseException) -> str:
    """Kind and message of an error, also of one whose message cannot be made."""
    try:
        return f"{type(error).__name__}: {error}"
    except Exception:  # noqa: BLE001  whatever a plugin's error does
        return type(error).__name__


def _log_results(report: Report, recorder: Recorder) -> None:
    """The summary of a study, and what it left out, into the logs."""
    if summary := "\n\n".join(filter(None, [_warned(list(recorder.warnings)), report.summary])):
        recorder.log("summary", Text(summary, markdown=True))
    for sentence in report.omitted:
        recorder.log("log", Text(f"left out: {sentence}"))


def _warned(warnings: Sequence[str]) -> str:
    """The first warnings as Markdown, above the results; "" without any."""
    shown = [f"> **Warning**: {' '.join(warning.split())}" for warning in warnings[:SHOWN]]
    if more := len(warnings) - len(shown):
        shown.append(f"> {more} more are in `{WARNINGS}`.")
    return "\n>\n".join(shown)


def manifest_of(
    run: Run, registry: Registry, overrides: Sequence[str], experiment: str, config_yaml: str, named: Named
) -> dict[str, Any]:
    """What is needed to know, and to repeat, a run."""
    files = file_digests("", run)
    return {
        "id": new_id(),
        "experiment": experiment,
        "overrides": list(overrides),
        "identity": job_identity(run, registry, files),
        "seed": run.seed,
        "config_hash": hashlib.sha256(config_yaml.encode()).hexdigest(),
        "components": named,
        "files": files,
        "plugins_failed": [failure.sentence for failure in registry.failures],
        **origin(),
    }


def _about(run: Run, named: Named) -> dict[str, Any]:
    """What a saved map says of the components that made it."""
    slots = ("descriptor", "distance", "sensor")
    config = OmegaConf.to_container(resolved(run), enum_to_str=True)
    assert isinstance(config, dict)
    return {
        "components": {slot: named[slot] for slot in slots if slot in named},
        "config": {slot: config[slot] for slot in slots if slot in named},
        "files": file_digests("", {slot: getattr(run, slot) for slot in slots if slot in named}),
        "omnilab": version("omnilab"),
    }


def _cache(run: Run) -> DiskCache | None:
    """Where descriptions and renderings are kept; None if they are not."""
    folder = cache_folder(run.logs, run.cache)
    return None if folder is None else DiskCache(folder, int(run.cache_gb * 1e9), run.threads)


def _parts(
    run: Run, registry: Registry, cache: DiskCache | None, shards: Shards, accelerator: Accelerator | None
) -> Parts:
    """The components that the study is given, on the device: descriptors and virtual cameras with the cache, all guarded."""
    kept = {"sensor", "descriptor"} if is_cached(run.study) else {"sensor"}  # or it measures what describing costs

    def given(kind: str, component: Any) -> Any:
        if component is None:
            return None
        title = registry.title_of(kind, component)
        working, computed_on = on_device(component, accelerator)
        own = cache.wrap(working, computed_on) if cache and kind in kept else working
        if kind != "descriptor" or kind not in kept:
            return guard(own, kind, title)
        registered = registry.of(component)
        return guard(own, kind, title, SpotCheck(working, title, registered.name if registered else "NAME"))

    parts: dict[str, Any] = {"map": run.map and load_places(Path(run.map)), "shards": shards}
    for kind in (kind for kind in KINDS.values() if kind.part):
        if kind.slot:
            parts[kind.name] = given(kind.name, getattr(run, kind.name))
        if kind.many:
            parts[kind.plural] = {name: given(kind.name, one) for name, one in getattr(run, kind.plural).items()}
    own = {name: registry.get("distance", d.default_distance).cls() for name, d in run.descriptors.items()}
    return Parts(**parts, default_distances={name: given("distance", one) for name, one in own.items()})


@contextmanager
def pinned(threads: int) -> Iterator[None]:
    """Fix the number of math threads, so that sums are made in the same order alone and in a sweep.

    Those of OpenMP, numba's too, sleep while they wait: as a rule they turn in circles, which on a busy machine takes a
    hundred times as long as a small image's work. That holds if OpenMP was not loaded before.
    """
    from threadpoolctl import threadpool_limits

    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    with threadpool_limits(limits=threads):
        yield


def _costs(recorder: Recorder, cache: DiskCache | None, wall_s: float) -> list[tuple[str, float, str]]:
    rows = [("wall", wall_s, "s")]
    for stage, (seconds, count) in recorder.costs.items():
        rows.append((stage, seconds, "s"))
        if count > 1:
            rows.append((f"{stage}, each", 1e3 * seconds / count, "ms"))
    for method, made, found in (
        ("render", "rendered", "renderings taken from the cache"),
        ("describe", "described", "taken from the cache"),
    ):
        if cache is not None and cache.found[method] + cache.made[method] > 0:
            rows += [(made, cache.made[method], "images"), (found, cache.found[method], "images")]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    rows.append(("peak memory", peak / (2**20 if sys.platform == "darwin" else 2**10), "MiB"))
    return rows
