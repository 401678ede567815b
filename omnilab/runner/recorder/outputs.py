"""Where a run's records go: each sink with a lock and a thread of its own, and what Ctrl-C does meanwhile.

A record is written at once, by the thread that logs it: nothing lies in a queue when the process is killed, but for the few
actions of a study that `Recorder.aside` still has to run. Flushing and
closing are the business of the sink's thread, so that one that is slow, or hangs, keeps no other from its file.
"""

from __future__ import annotations

import logging
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from omnilab.api import Record, RunResult, Sink, TakesResult, Text, Tick
from omnilab.errors import PluginError, visible
from omnilab.run_header import HEADER

FLUSH_S = 0.5  # half of what a killed run may lose
PATIENCE_S = 5.0  # how long Ctrl-C waits for a sink that is at work
STUCK_S = 60.0  # how long a sink may flush or close
DROPPED_S = 2.0  # how long one that has failed may close
LOOK_S = 0.1  # how often what is waited for is looked at
TRIES = 10  # a sink that takes none of so many records in a row takes none at all
LONGEST = 500  # characters of a sentence
OF_THE_RECORD = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, PluginError)

log = logging.getLogger("omnilab")


class Interrupts:
    """Signals that come while sinks are at work wait until the record is whole, but not for ever."""

    def __init__(self) -> None:
        self._came: float | None = None
        self._number: int = signal.SIGINT
        self._since: float | None = None  # when the main thread went to work with a sink
        self._woken: float | None = None  # from which work
        self._waking = threading.Lock()

    def come(self, number: int = signal.SIGINT) -> None:
        """A signal: KeyboardInterrupt, unless it can wait."""
        self.remember()
        self._number = number
        if self._since is None or self.waited():
            raise KeyboardInterrupt

    def remember(self) -> None:
        """KeyboardInterrupt was raised, or is to be."""
        self._came = self._came or time.monotonic()

    def heard(self) -> None:
        """It has come to who ends the run."""
        self._came = None

    def waited(self) -> bool:
        """Whether a signal has waited for as long as it may."""
        return bool(self._came and self._since and time.monotonic() - max(self._came, self._since) > PATIENCE_S)

    @contextmanager
    def postponed(self) -> Iterator[None]:
        """Work that no signal should tear. None comes to other threads than the main one."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        self.at_work()
        try:
            yield
        finally:
            self._since = None
        if self._came:
            raise KeyboardInterrupt

    def at_work(self) -> None:
        """Another sink's turn. Only the main thread hears signals."""
        if threading.current_thread() is threading.main_thread():
            self._since = time.monotonic()

    def wake(self) -> None:
        """Tear the main thread from a sink that it has been waiting for too long."""
        ident = threading.main_thread().ident
        with self._waking:
            if ident is not None and self._woken != self._since and self.waited():
                self._woken = self._since  # once: what it does next is to be whole again
                signal.pthread_kill(ident, self._number)


class Output:
    """A sink, its lock, and the thread that flushes and closes it."""

    def __init__(
        self,
        name: str,
        sink: Sink,
        timed: Callable[[str], AbstractContextManager[None]],
        interrupts: Interrupts,
        dropped: dict[str, str],
    ) -> None:
        self.name, self.sink, self.dropped = name, sink, dropped
        self.ends = threading.Event()  # the run does, or the sink has failed
        self.header: Text | None = None  # the last record
        self.result: RunResult | None = None  # what a sink may write down before it is closed
        self._timed, self._interrupts = timed, interrupts
        self._lock = threading.Lock()
        self._opened = False
        self._left_out = self._in_a_row = 0  # records
        self._thread = threading.Thread(target=self._keep_flushed, name=f"omnilab-{name}", daemon=True)

    def at_work(self) -> bool:
        return self._lock.locked()

    def open(self, folder: Path | None) -> None:
        """Start the sink's thread, and open the sink."""

        def start() -> None:
            self._thread.start()
            self.sink.open(folder)  # type: ignore[arg-type]  # sinks that write no file take None
            self._opened = True

        self._interrupts.at_work()
        self._lock.acquire()
        self._attempt(start)

    def write(self, path: str, record: Record, tick: Tick | None) -> None:
        """Hand the sink a record, unless it has failed before."""
        if self.name in self.dropped:
            return
        self._interrupts.at_work()
        try:
            self._wait_until(lambda: self._lock.acquire(timeout=LOOK_S), "does not come back from writing its file")
        except TimeoutError as error:
            self._drop(error)
        else:
            with np.errstate(all="ignore"):  # NaN in a record is what is to be seen in the log
                self._attempt(lambda: self.sink.write(path, record, tick), path)

    def give_up(self, why: str) -> None:
        """Drop the sink if it is at work."""
        if self.at_work() and self.name not in self.dropped:
            self._drop(TimeoutError(why), why)

    def join(self) -> None:
        """Wait until the file is complete; a sink that does not end is dropped."""

        def ended() -> bool:
            self._thread.join(LOOK_S)
            return not self._thread.is_alive()

        if self._thread.ident is not None:
            try:
                self._wait_until(
                    ended, "does not complete its file", DROPPED_S if self.name in self.dropped else STUCK_S
                )
            except TimeoutError as error:
                self._drop(error)
        if self._left_out > 1 and self.name not in self.dropped:
            log.warning("sink '%s' has left out %d records", self.name, self._left_out)

    def _keep_flushed(self) -> None:
        while not self.ends.wait(FLUSH_S):
            self._interrupts.wake()
            if self._opened and self._lock.acquire(timeout=FLUSH_S):
                self._attempt(self.sink.flush)
        if not self._opened:
            return
        sink, header, result = self.sink, self.header, self.result
        if header and self.name not in self.dropped:
            self._lock.acquire()
            self._attempt(lambda: sink.write(HEADER, header, None), HEADER)
        if result and isinstance(sink, TakesResult) and self.name not in self.dropped:
            self._lock.acquire()
            self._attempt(lambda: sink.conclude(result), "result")
        self._lock.acquire()
        self._attempt(sink.close)

    def _attempt(self, action: Callable[[], Any], path: str | None = None) -> None:
        """Do something with the sink, whose lock is held until then.

        What it raises costs the record under `path`, or else the sink, never the run.
        """
        try:
            with self._timed(f"sink {self.name}"):
                action()
        except KeyboardInterrupt as error:
            if threading.current_thread() is self._thread:  # where none comes from outside
                self._drop(error)
            else:
                self._interrupts.remember()
                if self._interrupts.waited():
                    self._drop(error, "it hung when the run was interrupted")
        except BaseException as error:  # noqa: BLE001  also a sink that would end the process costs no run
            if path is None or not isinstance(error, OF_THE_RECORD):
                self._drop(error)
            else:
                self._leave_out(path, error)
        else:
            if path is not None:
                self._in_a_row = 0
        finally:
            self._lock.release()

    def _wait_until(self, there: Callable[[], bool], what: str, longest_s: float | None = None) -> None:
        """TimeoutError if it takes too long, or longer than an interrupted run should last."""
        end = time.monotonic() + (STUCK_S if longest_s is None else longest_s)
        while True:
            try:
                if there():
                    return
            except KeyboardInterrupt:
                self._interrupts.remember()
            if time.monotonic() > end or self._interrupts.waited():
                raise TimeoutError(f"it {what}")

    def _leave_out(self, path: str, error: BaseException) -> None:
        self._left_out, self._in_a_row = self._left_out + 1, self._in_a_row + 1
        if self._left_out == 1:
            log.warning(
                "sink '%s' cannot take the record '%s', which is left out there: %s",
                self.name, visible(path), in_a_line(error),
            )  # fmt: skip
        if self._in_a_row == TRIES:
            self._drop(error, f"it could take none of {TRIES} records, at last '{visible(path)}': {in_a_line(error)}")

    def _drop(self, error: BaseException, why: str = "") -> None:
        if self.name in self.dropped:
            log.info("sink '%s' failed again", self.name, exc_info=error)
            return
        self.dropped[self.name] = why or in_a_line(error)
        self.ends.set()
        log.warning("sink '%s' failed and is switched off, the run goes on: %s", self.name, self.dropped[self.name])
        log.info("traceback of sink '%s'", self.name, exc_info=error)


def in_a_line(error: BaseException) -> str:
    """An error with its kind, in a line that is not too long."""
    line = " ".join(f"{type(error).__name__}: {error}".split())
    return visible(line if len(line) <= LONGEST else f"{line[:LONGEST]}...")
