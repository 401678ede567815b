"""Signals that end a process: not within imports, nor while results are written.

Nothing but the standard library is imported here.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Self

PATIENCE_S = 10.0  # after which a signal ends also what should not be interrupted
SLOW_S = 10.0  # what takes longer is said, and Ctrl-C ends it

_came: list[int] = []  # each Ctrl-C that waits
_slow = threading.Event()


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Ctrl-C waits until all is imported: libraries with a bare `except` would swallow it there. Nothing is collected."""
    try:
        before = signal.signal(signal.SIGINT, _hold)
    except ValueError:  # not in the main thread: whoever runs us there has signals in hand
        yield
        return
    if before is not _hold:
        _came.clear()
    try:
        with uncollected():
            yield
    finally:
        signal.signal(signal.SIGINT, before)
    if _came:
        raise KeyboardInterrupt


@contextmanager
def uncollected() -> Iterator[None]:
    """Garbage is not looked for: imports leave none, and that takes a tenth of their time.

    What they brought is here to stay, and never looked through.
    """
    collects, modules = gc.isenabled(), len(sys.modules)
    gc.disable()
    try:
        yield
    finally:
        if collects:
            if len(sys.modules) > modules:
                gc.freeze()
            gc.enable()


def interrupted() -> bool:
    """Whether a Ctrl-C waits."""
    return bool(_came)


def _hold(number: int, _: object) -> None:
    _came.append(number)
    if _slow.is_set():
        if len(_came) > 2:  # those before were swallowed
            os._exit(130)
        raise KeyboardInterrupt


@contextmanager
def noticed(say: Callable[[], None]) -> Iterator[None]:
    """`say()` when what follows takes longer than `SLOW_S`; from then on Ctrl-C ends it, also one that waits."""

    def late() -> None:
        say()
        _slow.set()
        if _came:
            signal.pthread_kill(caller, signal.SIGINT)  # wakes it from whatever it waits for

    caller = threading.get_ident()
    timer = threading.Timer(SLOW_S, late)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        timer.join()
        _slow.clear()


def _raise() -> None:
    raise KeyboardInterrupt


class HeldSignals:
    """Ctrl-C, SIGTERM and a terminal that goes away (SIGHUP) wait until the block has ended, except within `heard`.

    Then they are a KeyboardInterrupt. Under nohup a terminal that goes away is none of our business. A block that does
    not end within `PATIENCE_S` after a signal is ended by the next.
    """

    def __init__(self) -> None:
        self._came_s: float | None = None
        self._interrupt: Callable[[], object] | None = None
        self._before: dict[int, signal.Handlers | Callable[..., object] | int | None] = {}

    def __enter__(self) -> Self:
        numbers = [signal.SIGINT, signal.SIGTERM]
        if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
            numbers.append(signal.SIGHUP)
        if threading.current_thread() is threading.main_thread():  # else whoever runs us there has signals in hand
            for number in numbers:
                self._before[number] = signal.signal(number, self._came)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        if self._came_s is not None and kind is not KeyboardInterrupt:
            raise KeyboardInterrupt

    @contextmanager
    def heard(self, interrupt: Callable[[], object] = _raise) -> Iterator[None]:
        """Within this block a signal, also one that waits, does as `interrupt` says, which may raise KeyboardInterrupt."""
        self._interrupt = interrupt
        try:
            if self._came_s is not None:
                interrupt()
            yield
        finally:
            self._interrupt = None

    @contextmanager
    def held(self) -> Iterator[None]:
        """Within `heard`: here they wait again."""
        interrupt, self._interrupt = self._interrupt, None
        try:
            yield
        finally:
            self._interrupt = interrupt

    def _came(self, *_: object) -> None:
        now_s = time.monotonic()
        first_s, self._came_s = self._came_s, self._came_s or now_s
        if self._interrupt is not None:
            self._interrupt()
        elif first_s is not None and now_s - first_s > PATIENCE_S:
            raise KeyboardInterrupt
