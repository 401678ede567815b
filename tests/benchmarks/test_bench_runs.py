"""Commands in a process of their own: what a start takes, a run to its first record, and ten thousand finished runs."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from pathlib import Path

import pytest

RUNS, SEEDS = 10_000, 10  # as of the fixture
SCRIPT = Path(sys.executable).with_name("omnilab")
STARTS = {  # by what is typed
    "`omnilab plugins`": [SCRIPT, "plugins"],  # of which nothing has changed since it was listed
    "`omnilab plugins -v`": [SCRIPT, "plugins", "-v"],  # which loads all
    "`omnilab --version`": [SCRIPT, "--version"],
    "`omnilab experiment=quickstart --cfg job`": [SCRIPT, "experiment=quickstart", "--cfg", "job"],
}
ENDS = """
import os
from dataclasses import dataclass
from omnilab import hookimpl

@dataclass
class Ends:
    \"\"\"Ends the process with the first record, which all other sinks have; or with the first of a query.\"\"\"
    of_query: bool = False
    def open(self, folder): ...
    def write(self, path, record, tick):
        if tick is not None or not self.of_query:
            os._exit(0)
    def flush(self): ...
    def close(self): ...
    def repair(self, folder): ...

@hookimpl
def register_sinks(register):
    register("ends", Ends)
"""
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


@pytest.mark.benchmark(group="start of a command", timer=children_process_s)
@pytest.mark.parametrize("of_query", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_first_record(benchmark, of_query, tmp_path):
    """With both logs and the cache of an earlier run, as a second `omnilab` has them."""
    (tmp_path / "ends.py").write_text(ENDS)
    benchmark.extra_info["what"] = f"`omnilab`, to the first record{' of a query' if of_query else ''}"
    command = [SCRIPT, "+sink@sinks.ends=ends", f"sinks.ends.of_query={of_query}"]
    settings = {
        "check": True,
        "capture_output": True,
        "cwd": tmp_path,
        "env": os.environ | {"OMNILAB_PLUGINS": "ends.py"},
    }
    benchmark.pedantic(subprocess.run, [command], settings, rounds=5, warmup_rounds=1)
    assert len(list(tmp_path.glob("logs/quickstart/*/run.rrd"))) > 0


@pytest.mark.slow
@pytest.mark.benchmark(group="runs: ten thousand, by a command", timer=time.perf_counter)
@pytest.mark.parametrize(("command", "lines"), [("runs", RUNS + 2), ("compare", RUNS // SEEDS + 2)])
def test_ten_thousand_runs(benchmark, ten_thousand_runs, command, lines):
    def listed():
        return subprocess.run([SCRIPT, command, ten_thousand_runs], capture_output=True, text=True, check=True).stdout

    benchmark.extra_info["no_peer"] = "no other program reads these folders"
    assert len(benchmark.pedantic(listed, rounds=1).splitlines()) >= lines
