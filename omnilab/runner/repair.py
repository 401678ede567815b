"""Mending the logs of runs that were killed, by the sinks that wrote them; of all others, only copies."""

from __future__ import annotations

import os
import secrets
import shlex
import shutil
import stat
import tempfile
import traceback
import weakref
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnilab.api import Metric, Progress, RunResult
from omnilab.errors import DataError, OmnilabError
from omnilab.hooks import RunSummary
from omnilab.manifest import read_manifest
from omnilab.run_header import in_words, run_header
from omnilab.runner.run_folder import DONE, KILLED, RUNNING, SILENT, LoadedRun, RunFolder, load_run
from omnilab.runner.run_folder.lock import LOCK, REPAIR, RunLock
from omnilab.runner.run_folder.names import STATUS
from omnilab.runner.terminal import print_error, short

if TYPE_CHECKING:
    from omnilab.runner.registry import Registry


class RunsOnDisk:
    """The runs on disk, for commands of plugins: see `omnilab.hooks.Runs`."""

    def __init__(self, registry: Registry) -> None:
        self._registry = registry

    def ready(self, run: Path) -> Path:
        """The folder of a run, its logs mended first if it was killed; DataError if there is none.

        Of a run that goes on, or may, and of one that cannot be mended in its place: the folder of a mended copy.
        """
        loaded = load_run(run)
        state = loaded.state
        if loaded.alive:
            print_error(f"{loaded.lock.sentence(short(loaded.folder))}; a copy of what is there is shown")
            return self._copy(loaded)
        if state == KILLED:
            try:
                lock = RunLock.take(loaded.folder, REPAIR, ended=True)
            except DataError as error:
                print_error(f"{error}; a mended copy is shown")
                return self._copy(loaded)
            with lock:
                done, failures = _mend(loaded.folder, self._registry)
            for sentence in done + failures:
                print_error(sentence)
        return loaded.folder

    def summary(self, run: Path) -> RunSummary:
        """What a run's folder says of it; DataError if there is none. What is damaged counts as not there."""
        loaded = load_run(run)

        def known(part: Callable[[], Any]) -> Any:
            with suppress(DataError):
                return part()
            return {}

        manifest = known(lambda: loaded.manifest)
        named = manifest.get("components")
        return RunSummary(
            loaded.folder,
            loaded.state,
            manifest.get("experiment", ""),
            manifest.get("overrides", ()),
            {slot: str(part.get("name")) for slot, part in named.items()} if isinstance(named, dict) else {},
            known(lambda: loaded.config),
            known(lambda: loaded.metrics),
            known(lambda: _header(loaded)) or "",
        )

    def _copy(self, run: LoadedRun) -> Path:
        place = tempfile.mkdtemp(prefix="omnilab-")
        weakref.finalize(self, shutil.rmtree, place, ignore_errors=True)  # at the latest when Python ends
        copy = Path(place) / run.folder.name
        for failure in _mended_copy(run, copy, self._registry)[1]:
            print_error(failure)
        return copy


def _header(run: LoadedRun) -> str:
    """What a viewer shows of a run first, as the run stands now."""
    state, now = run.state, run.progress
    came = in_words(Progress(now.stage, now.done, now.total)) if now and state != DONE else ""
    metrics = [Metric(name, value, run.units.get(name, "1")) for name, value in run.metrics.items()]
    result = RunResult(state, metrics, str(run.status.get("error", "")))
    return run_header(read_manifest(run.folder), state, result, came if state == RUNNING or not came else f"at {came}")


def mend(run: LoadedRun, registry: Registry, ended: bool = False) -> list[str]:
    """Every sink's repair of a run's files: what was done, in sentences. DataError if the run goes on, or may.

    `ended`: the caller knows that a run which cannot be seen from here has ended.
    """
    if run.state == RUNNING or (run.state == SILENT and not ended):
        raise run.lock.refusal(short(run.folder))
    try:
        lock = RunLock.take(run.folder, REPAIR, ended or run.status["status"] != RUNNING)
    except DataError:
        # where nothing can be written, nobody is in the way of those who look, and what is whole needs no more
        if os.access(run.folder, os.W_OK) or _mend(run.folder, registry) != ([], []):
            raise
        return []
    with lock:
        return _all_done(*_mend(run.folder, registry))


def mend_copy(run: LoadedRun, copy: Path, registry: Registry) -> list[str]:
    """The same on a copy in a new folder, whether the run goes on or not; the run itself is left alone."""
    if copy.exists() or copy.resolve().is_relative_to(run.folder):
        raise DataError(f"{copy} is there already, or lies in the run's folder; give a new folder elsewhere")
    return _all_done(*_mended_copy(run, copy, registry))


def _all_done(done: list[str], failures: list[str]) -> list[str]:
    """What was done; DataError if something could not be, after what was is printed."""
    if not failures:
        return done
    for sentence in done + failures[:-1]:
        print_error(sentence)
    raise DataError(failures[-1])


def _mend(folder: Path, registry: Registry) -> tuple[list[str], list[str]]:
    """Mend the files of each sink, in a folder that nobody else writes into: what was done, and what could not be."""
    done, failures = list[str](), list[str]()
    for name in registry.names("sink"):
        try:
            if sentence := registry.get("sink", name).cls().repair(folder):
                done.append(sentence)
        except OmnilabError as error:
            failures.append(str(error))
        except OSError as error:
            failures.append(_unwritten(f"the files of sink '{name}' in {folder} cannot be mended", error, folder))
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # noqa: BLE001  no sink keeps another from its repair
            traceback.print_exception(error)
            failures.append(
                f"sink '{name}' failed to mend its files in {folder} ({type(error).__name__}: {error}), which is a bug of"
                " its plugin"
            )
    try:
        if load_run(folder).status["status"] == RUNNING:
            RunFolder(folder).status(KILLED)
    except OSError as error:
        failures.append(_unwritten(f"{folder / STATUS} cannot be written", error, folder))
    return done, failures


def _unwritten(what: str, error: OSError, folder: Path) -> str:
    return f"{what} ({error.strerror}); a mended copy: omnilab repair {shlex.quote(str(folder))} --output DIR"


def _mended_copy(run: LoadedRun, copy: Path, registry: Registry) -> tuple[list[str], list[str]]:
    """Copy a run's folder, whoever writes there, into a new one, and mend the copy, which is there when it is done."""
    part = copy.with_name(f"{copy.name}.{os.getpid()}-{secrets.token_hex(4)}.part")
    try:
        part.mkdir(parents=True)
        files = dict(_files(run.folder))
        size, room = sum(files.values()), shutil.disk_usage(part).free
        if size > room:
            raise DataError(
                f"a copy of {run.folder} takes {size / 1e6:.0f} MB, and {copy} has room for {room / 1e6:.0f}; set TMPDIR, or"
                " --output of omnilab repair, to a folder with more"
            )
        for file in files:
            _copy_file(file, part / file.relative_to(run.folder))
        done, failures = _mend(part, registry)
        part.rename(copy)
    except OSError as error:
        raise DataError(f"{run.folder} cannot be copied to {copy} ({error.strerror}); give another folder") from error
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return done, [failure.replace(str(part), str(run.folder)) for failure in failures]


def _files(folder: Path) -> Iterator[tuple[Path, int]]:
    """What a copy of a run has, and its bytes: neither its lock, nor links, nor what is no file."""
    for place, _, names in os.walk(folder, onerror=_raise):
        for file in (Path(place, name) for name in names if name != LOCK):
            with suppress(FileNotFoundError):  # a run that goes on writes files under other names first
                found = file.lstat()
                if stat.S_ISREG(found.st_mode):
                    yield file, found.st_size


def _raise(error: OSError) -> None:
    raise error


def _copy_file(source: Path, target: Path) -> None:
    """As long as it is there; without its permissions, which may forbid to mend it."""
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        shutil.copyfile(source, target)
    except FileNotFoundError:
        if source.exists():
            raise
