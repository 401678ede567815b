"""`jobs.jsonl`: a line for each event in the life of a sweep's jobs, to which many processes append.

A line is written by one call, at the end of the file and under its lock. One that was torn by a kill or a full disk costs
itself alone. Disks that know no locks append whole lines too, unless they are a network's.
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

from omnilab.errors import DataError
from omnilab.file_kinds import content_of
from omnilab.runner.run_folder.names import DONE, FAILED, INTERRUPTED, KILLED, RUNNING

JOBS = "jobs.jsonl"
PLANNED, RESUMED = "planned", "resumed"
EVENTS = (PLANNED, RUNNING, DONE, FAILED, INTERRUPTED, KILLED, RESUMED)
LARGEST = 2**28  # bytes

Event = dict[str, Any]


@cache
def log_of(sweep: Path) -> JobLog:
    """The log of a sweep's folder: one in a process, which knows what the disk would not take."""
    return JobLog(sweep)


class JobLog:
    """Appends to a sweep's `jobs.jsonl`."""

    def __init__(self, folder: Path) -> None:
        self.file = folder / JOBS
        self.unwritten: list[Event] = []  # what the disk would not take: known to this process alone

    def append(self, *events: Mapping[str, Any]) -> OSError | None:
        """Append events, with the time; what kept them from being written, if something did."""
        with self.locked() as held:
            return held.append(*events)

    @contextmanager
    def locked(self) -> Iterator[HeldLog]:
        """The log, held against other processes where the disk knows locks."""
        descriptor: int | OSError
        try:
            descriptor = os.open(self.file, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW, 0o666)
        except OSError as error:
            yield HeldLog(self, error)
            return
        try:
            with suppress(OSError):
                fcntl.flock(descriptor, fcntl.LOCK_EX)
            yield HeldLog(self, descriptor)
        finally:
            os.close(descriptor)


class HeldLog:
    """The log while nobody else writes to it."""

    def __init__(self, log: JobLog, descriptor: int | OSError) -> None:
        self._log, self._descriptor = log, descriptor

    def append(self, *events: Mapping[str, Any]) -> OSError | None:
        """As `JobLog.append`."""
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        lines = [{"time": now, **event} for event in events]
        try:
            if isinstance(self._descriptor, OSError):
                raise self._descriptor
            _write(self._descriptor, "".join(json.dumps(line) + "\n" for line in lines).encode())
        except OSError as error:
            self._log.unwritten += lines
            return error
        return None


def _write(descriptor: int, text: bytes) -> None:
    """Append lines, whatever the last one lacks; what the disk takes only a part of is taken back."""
    size = os.fstat(descriptor).st_size
    if size and os.pread(descriptor, 1, size - 1) != b"\n":
        text = b"\n" + text
    try:
        done = os.write(descriptor, text)
        if done < len(text):
            os.write(descriptor, text[done:])  # says why
    except OSError:
        with suppress(OSError):
            os.ftruncate(descriptor, size)
        raise


def read_events(folder: Path) -> tuple[list[Event], int]:
    """The events of a sweep in their order, and how many lines are damaged; DataError if there is no such file."""
    try:
        text = content_of(folder / JOBS, LARGEST)
    except FileNotFoundError:
        raise DataError(f"{folder} holds no sweep (no {JOBS}); omnilab sweep list shows those there are") from None
    except (OSError, ValueError) as error:
        raise DataError(f"{folder / JOBS} cannot be read ({error}); mend or move it away") from error
    return events_in(text)


def events_in(text: bytes) -> tuple[list[Event], int]:
    """The events of whole lines, and how many of those are damaged."""
    found = [_event(line) for line in text.splitlines() if line.strip()]
    events = [event for event in found if event is not None]
    return events, len(found) - len(events)


def _event(line: bytes) -> Event | None:
    """None if the line is none of ours, or not whole."""
    try:
        event = json.loads(line)
    except (ValueError, RecursionError):
        return None
    if not isinstance(event, dict) or event.get("event") not in EVENTS:
        return None
    if event["event"] == RESUMED:
        return event
    overrides = event.get("overrides", [])
    whole = type(event.get("job")) is int and event["job"] >= 0 and isinstance(overrides, list)
    return event if whole and all(isinstance(each, str) for each in overrides) else None
