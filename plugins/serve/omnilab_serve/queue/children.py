"""The processes that run submissions: how one is started so that it can be found again, and how it is told to end.

A process outlives the service that started it. Its output goes to a file that the service locks before it starts the
process: the lock (flock) belongs to the open file, which the process takes over, so that from before its first instant
until its end, and never else, the file is locked. Where a disk has no locks, a mark in the environment tells.
"""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from datetime import datetime
from pathlib import Path

from omnilab.runner.run_folder import KILLED, process
from omnilab.runner.run_folder.lock import RUN, Holder
from omnilab_serve.commands import PROGRAM
from omnilab_serve.queue.submission_file import Attempt
from omnilab_serve.settings import TOKEN_VARIABLE

MARK = "OMNILAB_SUBMISSION"
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)  # the first, second and third time


def start_child(words: Sequence[str], directory: str, output: Path, mark: str) -> subprocess.Popen[bytes]:
    """A process of its own session, which nobody else's signals reach; OSError if there can be none."""
    output.unlink(missing_ok=True)  # of a start that came to nothing
    own = {name: value for name, value in os.environ.items() if name != TOKEN_VARIABLE}
    with output.open("xb") as out:
        with suppress(OSError):
            fcntl.flock(out, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return subprocess.Popen(
            [*PROGRAM, *words], stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.STDOUT, cwd=directory,
            start_new_session=True, env=own | {MARK: mark, "PYTHONUNBUFFERED": "1"},
        )  # fmt: skip


def holder_of(pid: int) -> Holder:
    """A process, by more than its number, which another gets later."""
    found = process.process(pid)
    return Holder(
        process.host(), process.boot_id(), process.machine_id(), pid, process.pid_namespace(),
        found and found.start_ticks, RUN, flock=False,
    )  # fmt: skip


def lives(start: Attempt, output: Path, mark: str) -> bool:
    """Whether the process of a start is there, or may be."""
    if start.process and is_visible(start.process):
        return process.lives(start.process.pid, start.process.process_start_ticks)
    held = is_held(output)
    if held is not None:
        return held
    if start.process:
        return start.process.state(datetime.fromisoformat(start.time).timestamp(), free=False) != KILLED
    return marked(mark) is not None


def is_visible(holder: Holder) -> bool:
    """Whether a process, while it lives, is seen from here."""
    return (holder.boot_id, holder.pid_namespace) == (process.boot_id(), process.pid_namespace())


def is_held(output: Path) -> bool | None:
    """Whether a process writes, or may still write, the output; None where the disk cannot tell."""
    try:
        descriptor = os.open(output, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except FileNotFoundError:
        return False
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return None
    finally:
        os.close(descriptor)
    return False


def marked(mark: str) -> int | None:
    """The process that was started with a mark, and leads its session; None if there is none, or it is not to be seen."""
    wanted, found = f"{MARK}={mark}".encode(), []
    for folder in Path("/proc").glob("[0-9]*"):
        pid = int(folder.name)
        with suppress(OSError):
            if wanted in (folder / "environ").read_bytes().split(b"\0") and os.getsid(pid) == pid:
                found.append(pid)
    return min(
        found, key=lambda pid: holder_of(pid).process_start_ticks or 0, default=None
    )  # it may have started others


def tell_to_end(holder: Holder, signals: int) -> None:
    """Send a process and all it started what is due the first (Ctrl-C), second (SIGTERM) or third time (SIGKILL)."""
    if is_visible(holder) and process.lives(holder.pid, holder.process_start_ticks):
        with suppress(ProcessLookupError):
            os.killpg(holder.pid, SIGNALS[min(signals, len(SIGNALS)) - 1])


def tail(output: Path, most: int = 16_384) -> str:
    """The end of what a process has printed; "" if it has printed nothing."""
    try:
        with output.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(max(0, size - most))
            text = file.read().decode(errors="replace")
    except OSError:
        return ""
    return text if size <= most else text.partition("\n")[2]
