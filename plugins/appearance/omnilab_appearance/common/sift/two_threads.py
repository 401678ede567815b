"""Work of an image in two threads: of OpenCV in parts that it does in one, and of compiled kernels.

Numba's own threads, and OpenMP's, wait for each other by turning in circles: on a busy machine that takes many times as
long as the work.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import TypeVar

T = TypeVar("T")


def in_two(work: Callable[[int, int], object], count: int, worth_it: bool) -> None:
    """Have `work` do the items from one number to below another: all of them, or each half in a thread if that is worth it.

    Items do not depend on each other; of work, see `beside`.
    """
    if worth_it and has_another():
        beside(lambda: work(count // 2, count), lambda: work(0, count // 2), worth_it)
    else:
        work(0, count)


def beside(other: Callable[[], T], own: Callable[[], object], worth_it: bool) -> T:
    """Do `own` work here and `other` work, whose result it returns, in another thread if that is worth it, or after it.

    After it, too, where there is no other thread. Work frees Python's lock. What runs in the other thread must have no
    work done beside it: there is no third.
    """
    if not worth_it or not has_another():
        own()
        return other()
    result = _other_thread().submit(other)
    own()
    return result.result()


def has_another() -> bool:
    """Whether there may be another thread: there may where OpenCV has more than one."""
    import cv2

    return cv2.getNumThreads() > 1


@lru_cache(maxsize=1)
def _other_thread() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1, "omnilab-image")


os.register_at_fork(after_in_child=_other_thread.cache_clear)  # a thread does not live on in a forked process
