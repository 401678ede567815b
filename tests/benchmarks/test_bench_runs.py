"""Commands in a process of their own: what a start takes, and ten thousand finished runs listed and compared."""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from pathlib import Path

import pytest

RUNS, SEEDS = 10_000, 10  # as of the fixture
SCRIPT = Path(sys.executable).with_name("omnilab")
STARTS = {  # by what is typed
    "`omnilab plugins`": [SCRIPT, "plugins"],
    "`omnilab --version`": [SCRIPT, "--version"],
    "`omnilab experiment=quickstart --cfg job`": [SCRIPT, "experiment=quickstart", "--cfg", "job"],
}
PEERS = {f"`import {name}`": [sys.executable, "-c", f"import {name}"] for name in ("numpy", "hydra")}


def children_process_s():
    """Processor time of the processes that have ended: a busy machine makes them wait, and not work more."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


@pytest.mark.benchmark(group="start of a command", timer=children_process_s)
@pytest.mark.parametrize("what", [*STARTS, *PEERS])
def test_start(benchmark, what):
    benchmark.extra_info.update(what=what, peer=what in PEERS)
    command = {**STARTS, **PEERS}[what]
    benchmark.pedantic(subprocess.run, [command], {"check": True, "capture_output": True}, rounds=7, warmup_rounds=1)


@pytest.mark.slow
@pytest.mark.benchmark(group="runs: ten thousand, by a command", timer=time.perf_counter)
@pytest.mark.parametrize(("command", "lines"), [("runs", RUNS + 2), ("compare", RUNS // SEEDS + 2)])
def test_ten_thousand_runs(benchmark, ten_thousand_runs, command, lines):
    def listed():
        return subprocess.run([SCRIPT, command, ten_thousand_runs], capture_output=True, text=True, check=True).stdout

    benchmark.extra_info["no_peer"] = "no other program reads these folders"
    assert len(benchmark.pedantic(listed, rounds=1).splitlines()) >= lines
