"""Memory of a run: what is freed stays with the process, for the next image of the same size."""

from __future__ import annotations

import ctypes

TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3  # glibc, malloc.h
MOST_KEPT = 2**28  # bytes that are free at the end of the heap before they go back to the system
LARGEST = 2**25  # bytes of an array that lies on the heap; larger ones come from the system, and go back, one by one


def keep_freed() -> None:
    """Let the C library keep what is freed, up to MOST_KEPT bytes; nothing happens where it is not glibc.

    Pictures and their scale spaces are megabytes each, made and freed with every image. As a rule each of them is asked
    of the system anew, which hands it over page by page: for SIFT on a panorama that takes as long as all else.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(MMAP_THRESHOLD, LARGEST)
        mallopt(TRIM_THRESHOLD, MOST_KEPT)
