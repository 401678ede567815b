"""What a worker of a parallel launcher keeps between its jobs."""

from __future__ import annotations

import os
import subprocess
import sys

SCRIPT = """
import cv2
from hydra.core.plugins import Plugins
from hydra.core.singleton import Singleton

from omnilab.runner.sweeps.worker import registry_of_worker

registry, plugins = registry_of_worker(), Plugins.instance()
Singleton._instances = {}  # as Hydra does before each job
assert Plugins.instance() is plugins
assert registry_of_worker() is registry
assert cv2.getNumThreads() == 1
"""


def test_a_worker_looks_for_plugins_once_and_holds_to_its_share_of_the_cores():
    env = os.environ | {"NUMBA_NUM_THREADS": "1", "OMNILAB_PLUGINS": "none"}
    done = subprocess.run([sys.executable, "-c", SCRIPT], env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
