"""A process with a queue that is killed at a step of its first submission: `doomed_queue.py LOGS STEP [OVERRIDE ...]`."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from queue_for_tests import queue_of

from omnilab.client import SubmissionRequest
from omnilab_serve.queue import children, run_queue


def die(*_: object, **__: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


logs, step, *overrides = sys.argv[1:]
start_child = children.start_child
if step == "file":  # it says running
    children.start_child = die
elif step == "locked":  # its output is
    children.subprocess.Popen = die
elif step == "started":  # its process, which nothing names
    children.start_child = lambda *arguments: (start_child(*arguments), die())
elif step == "named":
    run_queue.RunQueue._watch = die
elif step == "ended":
    run_queue.RunQueue._end = die
queue = queue_of(Path(logs))
queue.start()
with queue._mutex:  # neither is begun before both are there
    for priority in (1, 0):
        queue.submit(SubmissionRequest(["experiment=quick", *overrides], priority))
if step == "waiting":
    while not Path(os.environ["STARTS"]).exists():
        time.sleep(0.02)
    die()
time.sleep(60)
assert subprocess, "it should have died"
