"""Stands for `omnilab` in tests of the queue: notes that it was started, and ends when it is told to, or at once.

Words: `wait=FILE` until there is such a file; `ends=done|failed|nothing`, what its folder says then; `deaf=on`: no signal but
SIGKILL ends it.
"""

from __future__ import annotations

import fcntl
import json
import os
import signal
import sys
import time
from pathlib import Path

given = dict(word.split("=", 1) for word in sys.argv[1:] if "=" in word)
named = [given[name] for name in ("hydra.run.dir", "hydra.sweep.dir", "resume") if name in given]
folder = Path((named or [sys.argv[3]])[0].strip("'"))  # of `sweep resume FOLDER`, too
with Path(os.environ["STARTS"]).open("a") as starts:
    fcntl.flock(starts, fcntl.LOCK_EX)
    starts.write(f"{os.environ['OMNILAB_SUBMISSION']} {' '.join(sys.argv[1:])}\n")
if given.get("deaf"):
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
sys.stderr.write("it begins\n")
try:
    while (wait := given.get("wait")) and not Path(wait).exists():
        time.sleep(0.02)
    ends = given.get("ends", "done")
except KeyboardInterrupt:
    ends = "interrupted"
if ends == "nothing":
    sys.exit("omnilab: that cannot be")
folder.mkdir(parents=True, exist_ok=True)
(folder / "status.json").write_text(
    json.dumps({"status": ends, "time": "2026-01-01T00:00:00+00:00", "pid": os.getpid()})
)
