"""The lock of a run folder: `run.lock` says which process writes there, and shows for how long it has.

The file is held with flock, which ends with the process, and its time of change is a heartbeat. Where a lock of another
host, boot or container is not seen here (shared disks), the heartbeat alone counts.
"""

from __future__ import annotations

import errno
import fcntl
import json
import logging
import os
import shlex
import stat
import threading
import time
import weakref
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import NoneType
from typing import Any, Self

from omnilab.errors import DataError
from omnilab.file_kinds import content_of
from omnilab.runner.run_folder import process
from omnilab.runner.run_folder.names import (
    CONFIG,
    KILLED,
    MANIFEST,
    RESERVED,
    RUN_LOG,
    RUNNING,
    SILENT,
    STATUS,
    SUMMARY,
)

LOCK = "run.lock"
RUN, REPAIR = "run", "repair"  # what a lock is held for
HEARTBEAT_S = 5.0
FRESH_S = 60.0  # no older heartbeat is one; a C library may keep the thread from its work for long
TAKING_S = 2.0  # a reader holds a lock for microseconds
LARGEST_BYTES = 4096
ELSEWHERE = "give another hydra.run.dir (of a sweep: hydra.sweep.dir)"
PADDED_BYTES = 1000  # so that one text replaces another whole, also on a full disk
TEXT, NUMBER = (str, NoneType), (int, NoneType)
TYPES = {
    "host": (str,), "boot_id": TEXT, "machine": TEXT, "pid": (int,), "pid_namespace": NUMBER,
    "process_start_ticks": NUMBER, "purpose": (str,), "flock": (bool,),
}  # fmt: skip

log = logging.getLogger("omnilab")
_held: weakref.WeakSet[RunLock] = weakref.WeakSet()


@dataclass(frozen=True)
class Holder:
    """The process that took a lock, as `run.lock` says it."""

    host: str
    boot_id: str | None
    machine: str | None  # a digest of its machine-id
    pid: int
    pid_namespace: int | None
    process_start_ticks: int | None  # since the host was started
    purpose: str
    flock: bool  # whether the disk could lock the file

    @classmethod
    def here(cls, purpose: str, flock: bool) -> Self:
        found = process.process(os.getpid())
        return cls(
            process.host(), process.boot_id(), process.machine_id(), os.getpid(), process.pid_namespace(),
            found and found.start_ticks, purpose, flock,
        )  # fmt: skip

    @classmethod
    def read(cls, text: bytes) -> Self | None:
        """None if the text is not that of a lock."""
        try:
            content = json.loads(text)
        except (ValueError, RecursionError):
            return None
        return cls.of(content) if isinstance(content, dict) else None

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> Self | None:
        """None if this is not what a lock says."""
        found: dict[str, Any] = {name: content.get(name) for name in TYPES}
        return cls(**found) if all(type(found[name]) in types for name, types in TYPES.items()) else None

    @property
    def is_of_this_host(self) -> bool:
        return self.machine is not None and (self.host, self.machine) == (process.host(), process.machine_id())

    def state(self, heartbeat_s: float, free: bool) -> str:
        """Of a lock that is not held as far as is seen here (`free`: and it would be seen): what became of the process."""
        if self.boot_id is not None and self.boot_id == process.boot_id():
            if free and self.flock:
                return KILLED
            if self.pid_namespace == process.pid_namespace():
                return RUNNING if process.lives(self.pid, self.process_start_ticks) else KILLED
        elif self.is_of_this_host and heartbeat_s < process.booted_s():
            return KILLED  # the host was started anew since
        return by_time(heartbeat_s)


@dataclass(frozen=True)
class LockState:
    """What a lock says of the process that took it: running, silent or killed, and in words who that is."""

    state: str
    purpose: str
    words: str

    def sentence(self, folder: Path) -> str:
        """Why a folder is left alone."""
        doing = "being repaired" if self.purpose == REPAIR else "running"
        if self.state == RUNNING:
            return f"{folder} is still {doing} {self.words}"
        return f"{folder} may still be {doing}, which cannot be told from here {self.words}"

    def refusal(self, folder: Path) -> DataError:
        """Of a repair, with what to do."""
        wait = "wait for it, or end it first"
        ask = f"look there, and if it has ended: omnilab repair --ended {shlex.quote(str(folder))}"
        return DataError(f"{self.sentence(folder)}; {wait if self.state == RUNNING else ask}")


def lock_state(folder: Path) -> LockState | None:
    """What the lock of a run folder says; None if there is none. Writes nothing, waits for nothing."""
    try:
        descriptor = os.open(folder / LOCK, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        return LockState(SILENT, RUN, f"({LOCK} cannot be read: {error.strerror})")
    try:
        if free := _flock(descriptor, fcntl.LOCK_SH):
            fcntl.flock(descriptor, fcntl.LOCK_UN)  # at once, for somebody may want it
        return _judged(descriptor, free)
    finally:
        os.close(descriptor)


def is_mine(folder: Path) -> bool:
    """Whether the lock of a folder is, or was, this process's."""
    try:
        found = Holder.read(content_of(folder / LOCK, LARGEST_BYTES))
    except OSError:
        return False
    return found is not None and replace(found, purpose=RUN, flock=True) == Holder.here(RUN, flock=True)


def _judged(descriptor: int, free: bool | None) -> LockState:
    """Of an open lock file; `free`: whether nobody holds it, None if that is not seen here."""
    held = os.fstat(descriptor)
    holder = Holder.read(os.pread(descriptor, LARGEST_BYTES, 0)) if stat.S_ISREG(held.st_mode) else None
    if free is False:
        state = RUNNING
    elif holder is None:
        state = by_time(held.st_mtime)
    else:
        state = holder.state(held.st_mtime, bool(free))
    who = f"(process {holder.pid}), on host {holder.host}" if holder else f"(a process that {LOCK} does not name)"
    return LockState(state, holder.purpose if holder else RUN, f"{who}, last heartbeat {ago(held.st_mtime)}")


def by_time(heartbeat_s: float) -> str:
    """A heartbeat of the future, by another clock, is none."""
    return RUNNING if abs(time.time() - heartbeat_s) < FRESH_S else SILENT


def ago(time_s: float) -> str:
    seconds = time.time() - time_s
    for unit, size in ("days", 86400), ("h", 3600), ("min", 60):
        if abs(seconds) >= 2 * size:
            return f"{seconds / size:.0f} {unit} ago"
    return f"{seconds:.0f} s ago"


class RunLock:
    """The lock on a run folder, held from `take` to `release`, or until the process ends."""

    def __init__(self, descriptor: int, flock: bool) -> None:
        self.flock = flock  # whether the disk could lock the file: if not, the heartbeat alone counts
        self._descriptor = descriptor
        self._content = os.pread(descriptor, LARGEST_BYTES, 0)
        self._stop = threading.Event()
        self._heart = threading.Thread(target=self._beat, name="omnilab-heartbeat", daemon=True)
        _held.add(self)
        self._heart.start()

    @classmethod
    def take(cls, folder: Path, purpose: str = RUN, ended: bool = False) -> RunLock:
        """Take the lock of a folder; DataError if another process has it, or may have.

        `ended`: the caller knows that a process which cannot be seen from here has ended.
        """
        path = folder / LOCK
        try:
            descriptor, new = _opened(path)
            try:
                flock = _taken(descriptor)
                if not new or flock is False:
                    _check_free(descriptor, flock, path, purpose, ended)
                _write(descriptor, Holder.here(purpose, bool(flock)))
            except BaseException:
                os.close(descriptor)
                raise
        except OSError as error:
            copy = f"a mended copy: omnilab repair {shlex.quote(str(folder))} --output DIR"
            advice = copy if purpose == REPAIR else "give another folder"
            raise DataError(f"{path} cannot be written ({error.strerror}); {advice}") from error
        return cls(descriptor, bool(flock))

    def release(self) -> None:
        """Let go of it; the file stays, for whoever removes it might remove one that is held anew."""
        self._stop.set()
        self._heart.join()
        self.leave()

    def leave(self) -> None:
        """Without more; in a process that was forked, for a child that outlives the run must not hold its lock."""
        if self in _held:
            _held.discard(self)
            os.close(self._descriptor)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def _beat(self) -> None:
        while not self._stop.wait(HEARTBEAT_S):
            try:
                if os.pread(self._descriptor, LARGEST_BYTES, 0) != self._content:
                    log.warning("%s: the logs of this run were mended from elsewhere, and what follows is lost", LOCK)
                    return  # as `repair --ended` was told to by somebody who was wrong
                os.utime(self._descriptor)
            except OSError as error:
                log.warning("the run's %s cannot be touched (%s): elsewhere it will look silent", LOCK, error.strerror)


def _leave_all() -> None:
    for lock in list(_held):
        lock.leave()


os.register_at_fork(after_in_child=_leave_all)


def _opened(path: Path) -> tuple[int, bool]:
    """A descriptor of the lock file, and whether it was made; OSError for links and what is no file."""
    flags = os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK
    try:
        return os.open(path, flags | os.O_CREAT | os.O_EXCL, 0o666), True
    except FileExistsError:
        descriptor = os.open(path, flags)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise OSError(errno.EINVAL, "it is no file")
    return descriptor, False


def _taken(descriptor: int) -> bool | None:
    """Whether the lock could be taken; None if the disk knows no locks."""
    deadline = time.monotonic() + TAKING_S
    while (taken := _flock(descriptor, fcntl.LOCK_EX)) is False and time.monotonic() < deadline:
        time.sleep(0.02)
    return taken


def _flock(descriptor: int, mode: int) -> bool | None:
    """Whether the lock was free, and is ours now; None if the disk cannot lock, as some network disks."""
    try:
        fcntl.flock(descriptor, mode | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True


def _check_free(descriptor: int, flock: bool | None, path: Path, purpose: str, ended: bool) -> None:
    """DataError if the process that took the lock before lives, or may live, or if the file is none of ours."""
    content = os.pread(descriptor, LARGEST_BYTES, 0)
    if not content and flock:
        return  # whoever made it was killed before it wrote a word
    if content and flock is not False and Holder.read(content) is None:
        raise DataError(f"{path} is no lock of omnilab; move it away")
    found = _judged(descriptor, flock)
    if found.state == RUNNING or (found.state == SILENT and not ended):
        if purpose == REPAIR:
            raise found.refusal(path.parent)
        raise DataError(f"{found.sentence(path.parent)}; {ELSEWHERE}")


def check_unused(folder: Path) -> None:
    """DataError if a run that writes into this folder could replace, or be mixed up with, what is there.

    There may be what Hydra puts there, and what a run that was killed while it began left of itself.
    """
    begun = {LOCK, CONFIG, MANIFEST, RUN_LOG, RESERVED} if (folder / LOCK).exists() else set[str]()
    for file in sorted(folder.iterdir()):
        of_hydra = file.name.startswith(".") or (file.suffix == ".log" and file.name != RUN_LOG) or file.is_dir()
        if not of_hydra and file.name not in begun and not (begun and file.suffix == ".part"):
            held = "a run" if (folder / STATUS).exists() else f"the file {file.name}"
            raise DataError(
                f"{folder} holds {held} already, which a new run might replace; {ELSEWHERE}, or move that one away"
            )


def lock_sweep(folder: Path) -> RunLock:
    """The lock of a sweep's folder; DataError if another sweep goes on there, or has left its jobs or its table."""
    _check_no_sweep(folder)
    lock = RunLock.take(folder)
    try:
        _check_no_sweep(folder)  # another may have begun and ended in between
    except DataError:
        lock.release()
        raise
    return lock


def _check_no_sweep(folder: Path) -> None:
    if (folder / SUMMARY).is_file() or any(folder.glob(f"*/{STATUS}")):
        if (found := lock_state(folder)) and found.state == RUNNING:
            raise DataError(f"{found.sentence(folder)}; {ELSEWHERE}")
        raise DataError(
            f"{folder} holds a sweep already; go on with it (omnilab sweep resume {shlex.quote(str(folder))}),"
            " or give another hydra.sweep.dir"
        )


def _write(descriptor: int, holder: Holder) -> None:
    text = (json.dumps(asdict(holder), indent=2).ljust(PADDED_BYTES - 1) + "\n").encode()
    os.pwrite(descriptor, text, 0)
    os.ftruncate(descriptor, len(text))
    os.utime(descriptor)
