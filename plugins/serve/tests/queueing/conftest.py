"""Queues whose submissions run a program of the tests, and what was started of it."""

from __future__ import annotations

import os
import signal
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from queue_for_tests import queue_of

from omnilab_serve.queue import RunQueue, children, run_queue


class Place:
    """Logs, and the programs that were started for them."""

    def __init__(self, folder: Path) -> None:
        self.logs, self.starts, self.go = folder / "logs", folder / "starts", folder / "go"

    def lines(self) -> list[str]:
        return self.starts.read_text().splitlines() if self.starts.exists() else []

    def started(self) -> Counter[str]:
        """How often each submission was begun."""
        return Counter(line.partition("-")[0] for line in self.lines())


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Place:
    found = Place(tmp_path)
    monkeypatch.setenv("STARTS", str(found.starts))
    return found


@pytest.fixture
def start(place: Place, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., RunQueue]]:
    """Starts a queue on the logs: `start()`, `start(workers=2)`. What its submissions run ends with the test."""
    monkeypatch.setattr(children, "PROGRAM", children.PROGRAM)  # which are put back so
    monkeypatch.setattr(run_queue, "check_request", run_queue.check_request)
    queues = []

    def start(workers: int = 1) -> RunQueue:
        queues.append(queue_of(place.logs, workers))
        queues[-1].start()
        return queues[-1]

    yield start
    for queue in queues:
        queue.stop()
    for record in queues[-1]._records.values() if queues else ():
        if record.state == "running" and (holder := record.starts[-1].process):
            with suppress(ProcessLookupError):
                os.killpg(holder.pid, signal.SIGKILL)
