"""Wall time of one call."""

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
