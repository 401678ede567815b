"""Imports without Ctrl-C and garbage collection in between. Nothing but the standard library is imported here."""

from __future__ import annotations

import gc
import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

SLOW_S = 10.0  # what takes longer is said, and Ctrl-C ends it

_came: list[int] = []  # each Ctrl-C that waits
_slow = threading.Event()


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Ctrl-C waits until all is imported: libraries with a bare `except` would swallow it there.

    So does garbage collection: imports leave none, and looking for it takes a tenth of their time.
    """
    collects = gc.isenabled()
    try:
        before = signal.signal(signal.SIGINT, _hold)
    except ValueError:  # not in the main thread: whoever runs us there has signals in hand
        yield
        return
    if before is not _hold:
        _came.clear()
    try:
        gc.disable()
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if collects:
            gc.enable()
    if _came:
        raise KeyboardInterrupt


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
