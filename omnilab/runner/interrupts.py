"""Imports without Ctrl-C and garbage collection in between. Nothing but the standard library is imported here."""

from __future__ import annotations

import gc
import signal
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Ctrl-C waits until all is imported: libraries with a bare `except` would swallow it there.

    So does garbage collection: imports leave none, and looking for it takes a tenth of their time.
    """
    came: list[int] = []
    collects = gc.isenabled()
    try:
        before = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    except ValueError:  # not in the main thread: whoever runs us there has signals in hand
        yield
        return
    try:
        gc.disable()
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if collects:
            gc.enable()
    if came:
        raise KeyboardInterrupt
