"""The recorder: hands every record to every sink, and measures what the stages cost."""

from __future__ import annotations

import logging
import signal
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Self, TypeVar

from omnilab import image
from omnilab.api import Image, Progress, Record, RunResult, Sink, Text, Tick
from omnilab.errors import visible
from omnilab.limits import Pace
from omnilab.runner.boundaries import read_only
from omnilab.runner.recorder.outputs import Interrupts, Output, in_a_line

T = TypeVar("T")
log = logging.getLogger("omnilab")


class Recorder:
    """Fans records out to sinks. Without sinks it only measures: ``Recorder()`` serves scripts and tests.

    Use it as a context manager; leaving it, for whatever reason, completes the files. A sink that fails is reported and
    dropped, and the run goes on. Sinks get the study's own arrays, as views that cannot be written to.
    """

    def __init__(
        self,
        sinks: Mapping[str, Sink] | None = None,
        folder: Path | None = None,
        note: Callable[[Progress], object] | None = None,  # how far each stage is, whatever sinks there are
    ) -> None:
        self.folder, self._note = folder, note
        self.dropped: dict[str, str] = {}  # sink: what was wrong with it
        self.warnings: dict[str, None] = {}  # what studies logged as such, each once
        self.costs: dict[str, tuple[float, int]] = {}  # stage: seconds, items
        self.result: RunResult | None = None  # what sinks may write down at the end
        self._interrupts = Interrupts()
        self._outputs = [
            Output(name, sink, self.timed, self._interrupts, self.dropped) for name, sink in (sinks or {}).items()
        ]
        self._unwritten: set[str] = set()  # paths of images that cannot be encoded

    def __enter__(self) -> Self:
        try:
            with self._interrupts.postponed():
                for output in self._outputs:
                    output.open(self.folder)
        except KeyboardInterrupt:
            self.__exit__(KeyboardInterrupt)
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None and issubclass(kind, KeyboardInterrupt):
            self._interrupts.heard()
        with self._interrupts.postponed():
            outputs, self._outputs = self._outputs, []
            for output in outputs:
                output.result = self.result
                output.ends.set()
            for output in outputs:
                output.join()

    def log(self, path: str, record: Record, tick: Tick | None = None) -> None:
        """Hand one record to every sink. Without a tick it holds for the whole run."""
        if isinstance(record, Text) and record.level == "WARN" and record.text not in self.warnings:
            self.warnings[record.text] = None
            log.info("warning: %s", visible(record.text))
        if isinstance(record, Progress) and self._note is not None:
            self._note(record)
        if not self._outputs:
            return
        if isinstance(record, Image) and not record.encoded:
            try:
                with self.timed("encode images"):
                    record = replace(record, encoded=image.encode(record.pixels, record.format))
            except Exception as error:  # noqa: BLE001  whatever OpenCV makes of it: pictures are for the logs
                if path not in self._unwritten:
                    self._unwritten.add(path)
                    log.warning("'%s' is no picture and left out of the logs: %s", visible(path), in_a_line(error))
                return
        record = read_only(record)
        with self._interrupts.postponed():
            for output in sorted(self._outputs, key=Output.at_work):  # one that is being flushed is waited for last
                output.write(path, record, tick)

    def interrupt(self, number: int = signal.SIGINT, _: object = None) -> None:
        """A signal handler: KeyboardInterrupt at once, or as soon as the record being written is whole.

        Should a library swallow it, the next record raises it again.
        """
        self._interrupts.come(number)

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
