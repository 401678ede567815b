"""The threads that take submissions, and the order in which they do: a queue of huey's, in SQLite."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from pathlib import Path

from huey import SqliteHuey
from huey.consumer import Consumer
from huey.serializer import SignedSerializer

FIRST_LOOK_S, LONGEST_LOOK_S = 0.1, 0.5  # between two looks at an empty queue
SCHEDULE_S = 60  # nothing is scheduled


class Workers:
    """Calls `take(identity, priority)` for what was added, the highest priority first, as many at once as there are workers.

    The file is made anew: what is in it can be told from the submissions, and no other's is read.
    """

    def __init__(self, file: Path, count: int, take: Callable[[str, int], None]) -> None:
        for path in (file, *(file.with_name(file.name + end) for end in ("-wal", "-shm"))):
            path.unlink(missing_ok=True)
        serializer = SignedSerializer(secret=secrets.token_hex())  # it reads pickles: our own alone
        self._huey = SqliteHuey("submissions", filename=str(file), results=False, fsync=False, serializer=serializer)
        self._take = self._huey.task(name="take")(take)
        self._consumer = _Consumer(
            self._huey, workers=count, periodic=False, initial_delay=FIRST_LOOK_S, max_delay=LONGEST_LOOK_S,
            scheduler_interval=SCHEDULE_S, check_worker_health=False,
        )  # fmt: skip

    def add(self, identity: str, priority: int) -> None:
        """Another to take."""
        self._take(identity, priority, priority=priority)

    def start(self) -> None:
        self._consumer.start()

    def stop(self) -> None:
        """Take no more; what was taken is left to its thread."""
        self._consumer.stop()


class _Consumer(Consumer):  # type: ignore[misc]  # huey has no types
    """In a thread of the web process, whose signals are its own."""

    def _set_signal_handlers(self) -> None:
        """None."""
