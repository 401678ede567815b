"""What a machine has, and what work needs of it: estimated before the work begins, and refused beyond what is there.

An estimate is of the least that is surely needed. `limits=off` asks for the work all the same.
"""

from __future__ import annotations

import math
import os
import resource
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from omnilab.errors import ConfigError

LONGEST_S = 86_400.0  # that a run may take by its estimate, unless asked for with limits=off
MEASURED_S = 10.0  # of work, before its time is extrapolated
OPENCV_HAS_NONE = ("cv2", -4)  # module and code of its error where it gets no memory
ASK_AGAIN = "limits=off to try it all the same"

_held: ContextVar[bool] = ContextVar("omnilab_limits", default=True)


@contextmanager
def limited(on: bool = True) -> Iterator[None]:
    """Within it work is refused beyond what is there, or is not with `on=False`.

    What does not fit into memory although nothing refused it ends in a ConfigError, which names what was asked for.
    """
    before, token = resource.getrlimit(resource.RLIMIT_DATA), _held.set(on)
    if on:  # what Linux would grant, and kill the process for when it is used, fails where it is asked for
        _lower(resource.RLIMIT_DATA, total_memory() + _own("VmData"))
    try:
        yield
    except Exception as error:
        if isinstance(error, MemoryError) or (type(error).__module__, getattr(error, "code", 0)) == OPENCV_HAS_NONE:
            raise out_of_memory(error) from error
        raise
    finally:
        _held.reset(token)
        resource.setrlimit(resource.RLIMIT_DATA, before)


def check_work(
    what: str, instead: str, *, memory: float = 0.0, seconds: float = 0.0, disk: float = 0.0, folder: Path | None = None
) -> None:
    """ConfigError if work takes more bytes of memory, seconds or bytes on the disk of `folder` than are there.

    `what` it is begins the sentence, in the plural; `instead` is what makes it smaller, as "give a larger step".
    """
    if not _held.get():
        return
    needs, there = [], []
    if memory > (free := free_memory()):
        needs.append(f"{size(memory)} of memory")
        there.append(f"{size(free)} are free")
    if disk and disk > (free := free_disk(folder or Path())):
        needs.append(f"{size(disk)} on disk")
        there.append(f"{size(free)} are free in {folder}")
    if seconds > LONGEST_S:
        needs.append(f"{hours(seconds)} of time")
        there.append(f"more than {hours(LONGEST_S)} are not begun unasked")
    if needs:
        needed = " and ".join(needs)
        raise ConfigError(f"{what} take at least {needed}, and {' and '.join(there)}; {instead}, or {ASK_AGAIN}")


class Pace:
    """The time that a stage of many items will take, from the first ones: once `add` knows it, it may be refused."""

    def __init__(self, stage: str, total: int) -> None:
        self._stage, self._total, self._done = stage, total, 0
        self._start: tuple[float, float, int] | None = (
            None  # when the first were done, which load and compile; how many
        )
        self._known = False

    def add(self, count: int) -> None:
        """So many items more are done. ConfigError, once, if the rest takes longer than a run should."""
        self._done += count
        now, at_work = time.perf_counter(), time.process_time()
        if self._start is None:
            self._start = now, at_work, self._done
        elapsed, items = now - self._start[0], self._done - self._start[2]
        if self._known or items < 1 or elapsed < MEASURED_S:
            return
        self._known = True
        own = min(elapsed, at_work - self._start[1])  # other programs may be at work, too, and end before this one
        seconds = own / items * (self._total - self._done)
        if elapsed < seconds / 100:  # else much is done: it shall not be lost for an estimate
            instead = "give fewer or smaller ones"
            check_work(f"the {self._total} items of the stage '{self._stage}'", instead, seconds=seconds)


# -------------------------------------------------------------------------------------------------- what a machine has
def free_memory() -> float:
    """Bytes that this process can still get: of the machine, of its control groups, under its own limits."""
    return max(0.0, min((limit - used for limit, used in _bounds()), default=math.inf))


def total_memory() -> float:
    """Bytes that there are for this process and all others within its bounds; infinity where that is not known."""
    return min((limit for limit, _ in _bounds()), default=math.inf)


def free_disk(folder: Path) -> float:
    """Bytes that are free on the disk of a folder, which need not exist yet."""
    there = next((path for path in (folder.absolute(), *folder.absolute().parents) if path.exists()), Path("/"))
    return float(shutil.disk_usage(there).free)


def _bounds() -> Iterator[tuple[float, float]]:
    """Limit and use, in bytes, of each bound on this process's memory that is known."""
    yield from _machine()
    yield from _control_groups(Path("/sys/fs/cgroup"), Path("/proc/self/cgroup"))
    for limit, field in ((resource.RLIMIT_AS, "VmSize"), (resource.RLIMIT_DATA, "VmData")):
        if (soft := resource.getrlimit(limit)[0]) != resource.RLIM_INFINITY:
            yield float(soft), _own(field)


def _machine() -> Iterator[tuple[float, float]]:
    there = _fields(Path("/proc/meminfo"))
    if {"MemTotal", "MemAvailable"} <= there.keys():
        total = there["MemTotal"] + there.get("SwapTotal", 0.0)
        yield total, total - there["MemAvailable"] - there.get("SwapFree", 0.0)
    else:
        with suppress(ValueError, OSError):  # a system without such names
            yield float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")), 0.0


def _control_groups(root: Path, own: Path) -> Iterator[tuple[float, float]]:
    """Of this process's control groups (`own`, of either version) and of all that they are in, below `root`."""
    for line in _text(own).splitlines():
        _, controllers, name = line.split(":", 2)
        if controllers == "":
            base, files = root, ("memory.max", "memory.current", "")
        elif "memory" in controllers.split(","):
            base, files = root / "memory", ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_")
        else:
            continue
        group = base / name.lstrip("/")
        for folder in (group, *group.parents):
            if folder.is_relative_to(base):
                limit, used = _text(folder / files[0]).strip(), _text(folder / files[1]).strip()
                if limit.isdigit() and used.isdigit():
                    kept = _fields(folder / "memory.stat", unit=1)  # pages of files, which make room where it is wanted
                    yield float(limit), float(used) - sum(kept.get(f"{files[2]}{n}_file", 0.0) for n in ("active", "inactive"))  # fmt: skip


def _own(field: str) -> float:
    """Bytes of this process, as /proc/self/status has them; 0 where there is none."""
    return _fields(Path("/proc/self/status")).get(field, 0.0)


def _fields(file: Path, unit: int = 1024) -> dict[str, float]:
    """The lines NAME NUMBER or NAME: NUMBER of a file, in bytes."""
    words = (line.replace(":", " ").split() for line in _text(file).splitlines())
    return {own[0]: float(own[1]) * unit for own in words if len(own) > 1 and own[1].isdigit()}


def _text(file: Path) -> str:
    try:
        return file.read_text()
    except OSError:
        return ""


def _lower(limit: int, bytes_: float) -> None:
    soft, hard = resource.getrlimit(limit)
    if math.isfinite(bytes_) and not 0 <= soft <= bytes_:  # RLIM_INFINITY is negative
        with suppress(ValueError, OSError):  # a system that has no such limit
            resource.setrlimit(limit, (int(bytes_), hard))


# ---------------------------------------------------------------------------------------------------------- in words
def out_of_memory(error: Exception) -> ConfigError:
    """The sentence about memory that was not there: what was asked for, and by which component."""
    requested = " ".join(str(error).split()) or "no memory is left"
    by = "; ".join(getattr(error, "__notes__", []))
    return ConfigError(
        f"the run does not fit into memory ({requested}{f', {by}' if by else ''}; {size(free_memory())} are free); give fewer"
        " places or images, a smaller size or batch of the sensor, or a smaller descriptor"
    )


def size(bytes_: float) -> str:
    """Bytes in words, as 22.9 GB."""
    return f"{_digits(bytes_ / 1e9)} GB" if bytes_ >= 1e8 else f"{_digits(bytes_ / 1e6)} MB"


def hours(seconds: float) -> str:
    """Seconds in words, as 36 hours."""
    return f"{_digits(seconds / 3600)} hours"


def _digits(value: float) -> str:
    """Three digits, and no power of ten: 0.12, 1.2, 1200."""
    return f"{float(f'{value:.3g}'):.15g}" if value < 1e15 else f"{value:.3g}"
