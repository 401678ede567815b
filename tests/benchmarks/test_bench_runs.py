"""Ten thousand finished runs, listed and compared, each in a process of its own as a user would."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

RUNS, SEEDS = 10_000, 10  # as of the fixture
SCRIPT = Path(sys.executable).with_name("omnilab")


@pytest.mark.benchmark(group="runs: ten thousand")
@pytest.mark.parametrize(("command", "lines"), [("runs", RUNS + 2), ("compare", RUNS // SEEDS + 2)])
def test_ten_thousand_runs(benchmark, ten_thousand_runs, command, lines):
    def listed():
        return subprocess.run([SCRIPT, command, ten_thousand_runs], capture_output=True, text=True, check=True).stdout

    assert len(benchmark.pedantic(listed, rounds=1).splitlines()) >= lines
