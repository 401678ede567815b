"""How a submission stands, by what the folder of its run or sweep says."""

from __future__ import annotations

import signal
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from omnilab.client import StageProgress
from omnilab.errors import DataError
from omnilab.runner.run_folder import DONE, FAILED, INTERRUPTED, KILLED, RUNNING, LoadedRun
from omnilab.runner.run_folder.names import STATUS
from omnilab.runner.run_folder.progress import read_progress
from omnilab.runner.sweeps import load_sweep
from omnilab.runner.sweeps.job_log import JOBS
from omnilab.runner.sweeps.snapshot import Snapshot, snapshot
from omnilab.runner.sweeps.status_table import overall, state
from omnilab_serve.index.records import stage_progress
from omnilab_serve.queue.submission_file import LONGEST_ERROR

FINISHED = (DONE, FAILED, INTERRUPTED)  # as the run itself has said
INTERRUPT_CODES = (130, -signal.SIGINT)  # with which a process ends that was interrupted


@dataclass(frozen=True)
class FolderState:
    """What a folder says."""

    state: str  # as of a run
    error: str | None = None


def state_of(folder: Path, sweep: bool, since: str) -> FolderState | None:
    """Of the run or sweep in a folder; None if it says nothing, or (of a sweep) nothing since a time."""
    try:
        return _of_sweep(folder, since) if sweep else _of_run(folder)
    except (DataError, OSError) as error:
        return FolderState(FAILED, str(error)[:LONGEST_ERROR])


def _of_run(folder: Path) -> FolderState | None:
    if not (folder / STATUS).is_file():
        return None
    run = LoadedRun(folder)
    error = run.status.get("error")
    return FolderState(run.state, error[:LONGEST_ERROR] if isinstance(error, str) else None)


def _of_sweep(folder: Path, since: str) -> FolderState | None:
    try:
        changed_s = (folder / JOBS).stat().st_mtime
    except OSError:
        return None
    if changed_s < datetime.fromisoformat(since).timestamp():
        return None
    seen = snapshot(load_sweep(folder))
    name = state(seen)
    if name == INTERRUPTED and not seen.of(INTERRUPTED):
        name = KILLED  # nobody interrupted it
    return FolderState(name, None if name in (DONE, RUNNING) else _of_jobs(seen))


def _of_jobs(seen: Snapshot) -> str:
    first = next((job.error for job in seen.of(FAILED) if job.error), None)
    return f"{overall(seen)}: {first[:LONGEST_ERROR]}" if first else overall(seen)


def ended_state(found: FolderState | None, code: int | None, signals: int, output: str) -> FolderState:
    """How a submission has ended whose process is gone; `code`: with which it ended, None where that is not known."""
    if found and found.state in FINISHED and not (found.state == INTERRUPTED and code == -signal.SIGKILL):
        return found
    if code is not None and code < 0 and code not in INTERRUPT_CODES:
        name = signal.Signals(-code).name
        return FolderState(KILLED, f"its process was ended by {name}" + _too_little_memory(code, signals))
    if code in INTERRUPT_CODES or signals:
        return FolderState(INTERRUPTED)
    if found:
        return FolderState(KILLED, found.error or "its process was ended from outside")
    lines = output.strip().splitlines()
    return FolderState(
        FAILED, lines[-1].removeprefix("omnilab: ")[:LONGEST_ERROR] if lines else f"it ended with code {code}"
    )


def _too_little_memory(code: int, signals: int) -> str:
    return "; the system does so where memory is too little" if code == -signal.SIGKILL and not signals else ""


def progress_of(folder: Path, sweep: bool) -> StageProgress | None:
    """How far what runs in a folder is; None where that is not known."""
    if not sweep:
        return stage_progress(read_progress(folder))
    if not (folder / JOBS).is_file():
        return None
    try:
        seen = snapshot(load_sweep(folder))
    except (DataError, OSError):  # which the sweep's page says
        return None
    return StageProgress(seen.fraction, f"{seen.ended} of {seen.total} jobs", seen.left_s)
