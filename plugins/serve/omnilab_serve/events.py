"""What has changed, for those who watch: pages are sent the names of topics, and fetch what they show of them."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator

RUNS, QUEUE = "runs", "queue"  # topics; besides, `run PATH` and `sweep PATH`


class Events:
    """Publishes topics to every watcher; what one has not taken yet is sent to it once."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._watchers: set[_Watcher] = set()
        self._closed = False

    @property
    def count(self) -> int:
        """How many watch."""
        return len(self._watchers)

    def publish(self, *topics: str) -> None:
        """Tell all watchers, from any thread."""
        with self._lock:
            watchers = list(self._watchers)
        for watcher in watchers:
            watcher.tell(topics)

    def close(self) -> None:
        """End all streams, which have no end of their own."""
        self._closed = True
        self.publish()

    async def watch(self) -> AsyncIterator[set[str]]:
        """The topics that have changed since the last time, again and again."""
        watcher = _Watcher(asyncio.get_running_loop())
        with self._lock:
            self._watchers.add(watcher)
        try:
            while not self._closed:
                if topics := await watcher.next():
                    yield topics
        finally:
            with self._lock:
                self._watchers.discard(watcher)


class _Watcher:
    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop, self._changed, self._topics = loop, asyncio.Event(), set[str]()

    def tell(self, topics: tuple[str, ...]) -> None:
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._add, topics)

    def _add(self, topics: tuple[str, ...]) -> None:
        self._topics.update(topics)
        self._changed.set()

    async def next(self) -> set[str]:
        await self._changed.wait()
        self._changed.clear()
        topics, self._topics = self._topics, set()
        return topics
