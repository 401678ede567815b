"""Work of an image in two threads: of OpenCV in parts that it does in one, and of compiled kernels.

Numba's own threads, and OpenMP's, wait for each other by turning in circles: on a busy machine that takes many times as
long as the work.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache


def in_two(work: Callable[[int, int], object], count: int, worth_it: bool) -> None:
    """Have `work` do the items from one number to below another: all of them, or each half in a thread if that is worth it.

    One thread, too, where OpenCV has only one. Work frees Python's lock, and items do not depend on each other.
    """
    import cv2

    if not worth_it or cv2.getNumThreads() < 2:
        work(0, count)
        return
    second = _other_thread().submit(work, count // 2, count)
    work(0, count // 2)
    second.result()


@lru_cache(maxsize=1)
def _other_thread() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1, "omnilab-sift")
