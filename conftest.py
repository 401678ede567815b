"""How the tests are run: pytest reads this before any test."""

from __future__ import annotations

import os


def pytest_xdist_auto_num_workers() -> int:
    """Half as many processes more than cores: tests wait for other processes, and their clocks, a fifth of their time."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return cores + cores // 2
