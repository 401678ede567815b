"""Wall time and processor time of one call."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def timed(action: Callable[[], T]) -> tuple[T, float]:
    """The result of a call, and its wall time in seconds."""
    start = time.perf_counter()
    result = action()
    return result, time.perf_counter() - start


def timed_twice(action: Callable[[], T]) -> tuple[T, float, float]:
    """The result of a call, its wall time, and the processor time of all threads meanwhile, in seconds."""
    start = time.process_time()
    result, seconds = timed(action)
    return result, seconds, time.process_time() - start
