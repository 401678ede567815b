"""Ten thousand finished runs, listed and compared, each in a process of its own as a user would."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

RUNS, SEEDS = 10_000, 10
OF_BEFORE = Path(__file__).parents[1] / "data/runs_0_1/grid"
BESIDE = ("run.log", "run.lock", "queries.csv", "run.rrd", "run.mcap", "errors.png", "rates.png", "map.png")
SCRIPT = Path(sys.executable).with_name("omnilab")


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Sweeps of a thousand jobs, over two settings and ten seeds."""
    folder = tmp_path_factory.mktemp("runs") / "logs"
    manifest, config, metrics, status = (
        (OF_BEFORE / name).read_text() for name in ("manifest.json", "config.yaml", "metrics.csv", "status.json")
    )
    for i in range(RUNS):
        seed, angles, offsets = i % SEEDS, 36 + i // SEEDS % 10, 24 + i // 100
        run = folder / f"sweep{i // 1000}" / str(i % 1000)
        run.mkdir(parents=True)
        settings = [f"seed={seed}", f"descriptor.angles={angles}", f"descriptor.offsets={offsets}"]
        own = json.loads(manifest) | {"seed": seed, "overrides": settings}
        text = config.replace("seed: 0", settings[0].replace("=", ": ")).replace("angles: 36", f"angles: {angles}")
        (run / "manifest.json").write_text(json.dumps(own, indent=2) + "\n")
        (run / "config.yaml").write_text(text.replace("offsets: 24", f"offsets: {offsets}"))
        (run / "metrics.csv").write_text(metrics.replace("nearest_rate,0.5", f"nearest_rate,0.{angles}{seed}"))
        (run / "status.json").write_text(status)
        (run / "cost.csv").write_text(f"cost,value,unit\nwall,{angles},s\n")
        for name in BESIDE:
            (run / name).touch()
    return folder


@pytest.mark.benchmark(group="runs: ten thousand")
@pytest.mark.parametrize(("command", "lines"), [("runs", RUNS + 2), ("compare", RUNS // SEEDS + 2)])
def test_ten_thousand_runs(benchmark, logs, command, lines):
    def listed():
        return subprocess.run([SCRIPT, command, logs], capture_output=True, text=True, check=True).stdout

    assert len(benchmark.pedantic(listed, rounds=1).splitlines()) >= lines
