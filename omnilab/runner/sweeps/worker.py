"""A process that a parallel launcher started: what it keeps from one job to the next, and how much of the machine it takes."""

from __future__ import annotations

import gc
import os
from functools import cache

from hydra.core.plugins import Plugins

from omnilab.runner.registry import Registry, discover
from omnilab.runner.streams import outlast

THREADS = "NUMBA_NUM_THREADS"  # set by joblib, beside those of BLAS: the cores for each worker


@cache
def registry_of_worker() -> Registry:
    """All plugins, looked for once in each process."""
    outlast()
    if THREADS in os.environ:
        import cv2

        cv2.setNumThreads(int(os.environ[THREADS]))  # two workers with pools over all cores wait for each other
    registry = discover()
    Plugins._instances = {Plugins: Plugins.instance()}  # type: ignore[dict-item]  # Hydra would scan for its own before each job
    return registry


@cache
def settle() -> None:
    """After a first job: what has been imported is here to stay, and is left out of each search for garbage from now on."""
    gc.collect()
    gc.freeze()
