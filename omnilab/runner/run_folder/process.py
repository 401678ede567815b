"""Which process this is, and whether another one still lives: host, boot, PID namespace, start time."""

from __future__ import annotations

import hashlib
import os
import platform
import subprocess
import sys
import time
from functools import cache
from pathlib import Path
from typing import NamedTuple

from omnilab.atomic_files import is_process

ENDED = (b"Z", b"X")  # states of a process that has ended, but whose parent did not take note


class Process(NamedTuple):
    """A process as /proc shows it."""

    start_ticks: int  # since the host was started
    ended: bool
    command: bytes


def host() -> str:
    return platform.node()


@cache
def boot_id() -> str | None:
    """A text that no two starts of any host share; None where the system has none."""
    if sys.platform == "darwin":
        call = ["sysctl", "-n", "kern.bootsessionuuid"]
        return subprocess.run(call, capture_output=True, text=True, check=False).stdout.strip() or None
    return _text("/proc/sys/kernel/random/boot_id")


@cache
def machine_id() -> str | None:
    """A digest of what the system's installation is known by, the same after it is started anew; None without."""
    known = _text("/etc/machine-id")
    return hashlib.sha256(f"omnilab {known}".encode()).hexdigest()[:16] if known else None


def booted_s() -> float:
    """When this host was started, in seconds since 1970."""
    return time.time() - time.clock_gettime(time.CLOCK_BOOTTIME)  # which only Linux has, as machine-id


def pid_namespace() -> int | None:
    """The namespace in which this process's number means it; None where there are none."""
    try:
        return Path("/proc/self/ns/pid").stat().st_ino
    except OSError:
        return None


def process(pid: int) -> Process | None:
    """The process of a number in our PID namespace; None if there is none, or if /proc does not show it."""
    try:
        if Path("/proc/self").readlink() != Path(str(os.getpid())):  # it is that of another namespace
            return None
        state, *fields = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()
        return Process(int(fields[18]), state in ENDED, Path(f"/proc/{pid}/cmdline").read_bytes())
    except (OSError, IndexError, ValueError):
        return None


def lives(pid: int, start_ticks: int | None) -> bool:
    """Whether the process of this number, in our PID namespace, is there and is the one that started then."""
    found = process(pid)
    if found is None:
        return is_process(pid)
    return not found.ended and start_ticks in (None, found.start_ticks)


def started_s(found: Process) -> float:
    """When a process started, in seconds since 1970."""
    return booted_s() + found.start_ticks / os.sysconf("SC_CLK_TCK")


def _text(path: str) -> str | None:
    try:
        return Path(path).read_text(encoding="utf-8").strip() or None
    except (OSError, UnicodeDecodeError):
        return None
