"""The recorder: hands every record to every sink, and measures what the stages cost."""

from __future__ import annotations

import logging
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sized
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Self, TypeVar

from omnilab import image
from omnilab.api import Image, Progress, Record, RunResult, Sink, Text, Tick
from omnilab.errors import visible
from omnilab.limits import Pace
from omnilab.manifest import Manifest
from omnilab.run_header import HEADER, in_words, run_header
from omnilab.runner.boundaries import read_only, unsound_record
from omnilab.runner.interrupts import uncollected
from omnilab.runner.recorder.aside import Aside
from omnilab.runner.recorder.outputs import PATIENCE_S, Interrupts, Output, in_a_line

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
        manifest: Manifest | None = None,  # of the run: its header is the first record, and the last
    ) -> None:
        self.folder, self._note, self._manifest = folder, note, manifest
        self._stage: Progress | None = None  # the last that was logged
        self.dropped: dict[str, str] = {}  # sink: what was wrong with it
        self.warnings: dict[str, None] = {}  # what studies logged as such, each once
        self.costs: dict[str, tuple[float, int]] = {}  # stage: seconds, items
        self.result: RunResult | None = None  # what sinks may write down at the end
        self._adding = threading.Lock()
        self._interrupts = Interrupts()
        self._outputs = [
            Output(name, sink, self.timed, self._interrupts, self.dropped) for name, sink in (sinks or {}).items()
        ]
        self._unwritten: set[str] = set()  # paths of records that no sink can take

    def __enter__(self) -> Self:
        try:
            with self._interrupts.postponed(), uncollected():  # sinks import large libraries when they open
                for output in self._outputs:
                    output.open(self.folder)
                    if self._manifest is not None:
                        output.write(HEADER, self._header(self._manifest, None), None)
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
                if self._manifest is not None and self.result is not None:
                    output.header = self._header(self._manifest, self.result)
                output.ends.set()
            for output in outputs:
                output.join()

    def log(self, path: str, record: Record, tick: Tick | None = None) -> None:
        """Hand one record to every sink. Without a tick it holds for the whole run."""
        if isinstance(record, Text) and record.level == "WARN" and record.text not in self.warnings:
            self.warnings[record.text] = None
            log.info("warning: %s", visible(record.text))
        if isinstance(record, Progress):
            self._stage = record
            if self._note is not None:
                self._note(record)
        if not self._outputs:
            return
        if wrong := unsound_record(record):
            self._leave_out(path, "record", wrong)
            return
        if isinstance(record, Image) and not record.encoded:
            try:
                with self.timed("encode images"):
                    record = replace(record, encoded=image.encode(record.pixels, record.format))
            except Exception as error:  # noqa: BLE001  whatever OpenCV makes of it: pictures are for the logs
                self._leave_out(path, "picture", in_a_line(error))
                return
        record = read_only(record)
        with self._interrupts.postponed():
            for output in sorted(self._outputs, key=Output.at_work):  # one that is being flushed is waited for last
                output.write(path, record, tick)

    def _leave_out(self, path: str, what: str, why: str) -> None:
        """A record that no sink can take: said once for each path."""
        if path not in self._unwritten:
            self._unwritten.add(path)
            log.warning("'%s' is no %s and left out of the logs: %s", visible(path), what, why)

    def _header(self, manifest: Manifest, result: RunResult | None) -> Text:
        """How the run stands, with how far it came if it did not end well."""
        status = result.status if result else "running"
        came = in_words(self._stage) if status not in ("running", "done") else ""
        return Text(run_header(manifest, status, result, came and f"at {came}"), markdown=True)

    def interrupt(self, number: int = signal.SIGINT, _: object = None) -> None:
        """A signal handler: KeyboardInterrupt at once, or as soon as the record being written is whole.

        Should a library swallow it, the next record raises it again.
        """
        self._interrupts.come(number)

    def track(
        self, items: Iterable[T], stage: str, total: int, size: Callable[[Any], int] | None = None
    ) -> Iterator[T]:
        """Pass `items` on, telling the sinks after each how far the stage is (`size` of an item counts its parts).

        Without it, batches such as `Frames` count as many as they hold, and items that have no length as one.
        A line of `log` says when it has ended. ConfigError if it turns out that the stage takes longer than a run should (`omnilab.limits`).
        """
        done, pace, start = 0, Pace(stage, total), time.perf_counter()
        size = size or _size
        self.log("progress", Progress(stage, done, total))
        for item in items:
            yield item
            count = size(item)
            done += count
            self.log("progress", Progress(stage, done, total))
            pace.add(count)
        self.log("log", Text(f"{stage}: {done} done in {time.perf_counter() - start:.1f} s"))

    @contextmanager
    def aside(self) -> Iterator[Callable[[Callable[[], object]], object]]:
        """A thread that makes and logs records while the study goes on: it is handed actions, which it runs in order.

        Few wait at a time. At the end all are done, unless a sink hangs while the run is interrupted: that one is dropped.
        Without sinks an action is run at once.
        """
        if not self._outputs:
            yield lambda action: action()
            return
        aside = Aside()
        try:
            yield aside
        except BaseException:
            with suppress(Exception):  # the first error counts
                if not aside.end(PATIENCE_S):
                    for output in self._outputs:
                        output.give_up("it hung when the run ended")
            raise
        aside.end()

    @contextmanager
    def timed(self, stage: str, count: int = 1) -> Iterator[None]:
        """Measure the wall time of a stage over `count` items; the sums land in the run's cost table."""
        start = time.perf_counter()
        try:
            yield
        finally:
            with self._adding:
                seconds, items = self.costs.get(stage, (0.0, 0))
                self.costs[stage] = (seconds + time.perf_counter() - start, items + count)


def _size(item: object) -> int:
    return len(item) if isinstance(item, Sized) else 1
