"""Ctrl-C for a run or sweep that was started elsewhere on this machine."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from omnilab.errors import DataError
from omnilab.file_kinds import content_of
from omnilab.runner.run_folder import RUNNING, process
from omnilab.runner.run_folder.lock import LARGEST_BYTES, LOCK, RUN, Holder, lock_state
from omnilab.runner.sweeps.job_log import JOBS
from omnilab_serve.queue.children import is_visible


def interrupt_holder(folder: Path, path: str) -> None:
    """Send Ctrl-C to the process that has the lock of a folder; DataError unless it surely is that process."""
    if (folder.parent / JOBS).is_file():
        raise DataError(f"{path} is a job of a sweep, whose process may run other jobs; stop the sweep, and resume it")
    found, holder = lock_state(folder), _holder(folder)
    if found is None or holder is None or found.state != RUNNING or holder.purpose != RUN:
        raise DataError(f"{path} does not run, as far as is seen from here; there is nothing to stop")
    if not is_visible(holder):
        raise DataError(f"{path} runs elsewhere {found.words}; stop it there")
    if not _has_lock(holder, folder / LOCK):
        raise DataError(f"process {holder.pid}, which the {LOCK} of {path} names, is another; nothing was stopped")
    try:
        if os.getpgid(holder.pid) == holder.pid:  # as a shell starts commands: Ctrl-C reaches all of these
            os.killpg(holder.pid, signal.SIGINT)
        else:
            os.kill(holder.pid, signal.SIGINT)
    except ProcessLookupError as error:
        raise DataError(f"{path} has just ended") from error
    except PermissionError as error:
        raise DataError(f"{path} is run by another user {found.words}; only they can stop it") from error


def _holder(folder: Path) -> Holder | None:
    try:
        return Holder.read(content_of(folder / LOCK, LARGEST_BYTES))
    except OSError:
        return None


def _has_lock(holder: Holder, lock: Path) -> bool:
    """Whether the process of this number started when the lock says, is a Python program, and has the lock open."""
    found = process.process(holder.pid)
    if found is None or found.ended or found.start_ticks != holder.process_start_ticks or holder.pid == os.getpid():
        return False
    if b"omnilab" not in found.command and b"python" not in found.command:
        return False
    wanted = lock.stat()
    return any(_is(descriptor, wanted) for descriptor in Path(f"/proc/{holder.pid}/fd").glob("*"))


def _is(descriptor: Path, wanted: os.stat_result) -> bool:
    try:
        return os.path.samestat(descriptor.stat(), wanted)
    except OSError:
        return False
