"""The recorder: hands every record to every sink, and measures what the stages cost."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Self, TypeVar

from omnilab import image
from omnilab.api import Image, Progress, Record, Sink, Text, Tick
from omnilab.limits import Pace

T = TypeVar("T")
log = logging.getLogger("omnilab")

FLUSH_S = 1.0


class Recorder:
    """Fans records out to sinks. Without sinks it only measures: ``Recorder()`` serves scripts and tests.

    Use it as a context manager; leaving it, for whatever reason, completes the files. A sink that raises is reported
    and dropped, and the run goes on.
    """

    def __init__(self, sinks: Mapping[str, Sink] | None = None, folder: Path | None = None) -> None:
        self.sinks = dict(sinks or {})
        self.folder = folder
        self.dropped: dict[str, str] = {}  # sink: what was wrong with it
        self.warnings: dict[str, None] = {}  # what studies logged as such, each once
        self.costs: dict[str, tuple[float, int]] = {}  # stage: seconds, items
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._writing = False
        self._interrupted = False

    def __enter__(self) -> Self:
        for name, sink in list(self.sinks.items()):
            self._attempt(name, lambda sink=sink: sink.open(self.folder))  # type: ignore[misc]
        if self.sinks:
            threading.Thread(target=self._keep_flushed, name="omnilab-flush", daemon=True).start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is KeyboardInterrupt:
            self._interrupted = False  # it has been heard
        self._stop.set()
        with self._whole():
            for name, sink in list(self.sinks.items()):
                self._attempt(name, sink.close)
            self.sinks.clear()

    def log(self, path: str, record: Record, tick: Tick | None = None) -> None:
        """Hand one record to every sink. Without a tick it holds for the whole run."""
        if isinstance(record, Text) and record.level == "WARN" and record.text not in self.warnings:
            self.warnings[record.text] = None
            log.info("warning: %s", record.text)
        if not self.sinks:
            return
        if isinstance(record, Image) and not record.encoded:
            with self.timed("encode images"):
                record = replace(record, encoded=image.encode(record.pixels, record.format))
        with self._whole():
            for name, sink in list(self.sinks.items()):
                self._attempt(name, lambda sink=sink: sink.write(path, record, tick))  # type: ignore[misc]

    def interrupt(self, *_: object) -> None:
        """A signal handler: KeyboardInterrupt at once, or as soon as the record being written is whole.

        Should a library swallow it, the next record raises it again.
        """
        self._interrupted = True
        if not self._writing:
            raise KeyboardInterrupt

    @contextmanager
    def _whole(self) -> Iterator[None]:
        """Not to be torn by a signal, nor by the flushing thread."""
        with self._lock:
            self._writing = True
            try:
                yield
            finally:
                self._writing = False
        if self._interrupted:
            raise KeyboardInterrupt

    def track(self, items: Iterable[T], stage: str, total: int, size: Callable[[Any], int] = len) -> Iterator[T]:
        """Pass `items` on, telling the sinks after each how far the stage is (`size` of an item counts its parts).

        ConfigError if it turns out that the stage takes longer than a run should (`omnilab.limits`).
        """
        done, pace = 0, Pace(stage, total)
        self.log("progress", Progress(stage, done, total))
        for item in items:
            yield item
            done += size(item)
            self.log("progress", Progress(stage, done, total))
            pace.add(size(item))

    @contextmanager
    def timed(self, stage: str, count: int = 1) -> Iterator[None]:
        """Measure the wall time of a stage over `count` items; the sums land in the run's cost table."""
        start = time.perf_counter()
        try:
            yield
        finally:
            seconds, items = self.costs.get(stage, (0.0, 0))
            self.costs[stage] = (seconds + time.perf_counter() - start, items + count)

    def _attempt(self, name: str, action: Callable[[], None]) -> None:
        try:
            with self.timed(f"sink {name}"):
                action()
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # also a sink that would end the process costs no run
            self.sinks.pop(name, None)
            self.dropped[name] = f"{type(error).__name__}: {error}"
            log.warning("sink '%s' failed and is switched off, the run goes on: %s", name, self.dropped[name])
            log.info("traceback of sink '%s'", name, exc_info=error)

    def _keep_flushed(self) -> None:
        while not self._stop.wait(FLUSH_S):
            with self._lock:
                for name, sink in list(self.sinks.items()):
                    self._attempt(name, sink.flush)
