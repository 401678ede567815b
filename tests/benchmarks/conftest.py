"""Benchmarks that are not asked to measure only show that they run: with the slow tests, without those that are slow themselves."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

RUNS, SEEDS = 10_000, 10
OF_BEFORE = Path(__file__).parents[1] / "data/runs_0_1/grid"
BESIDE = ("run.log", "run.lock", "queries.csv", "run.rrd", "run.mcap", "errors.png", "rates.png", "map.png")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if not config.getoption("benchmark_enable"):
        for item in items:
            if item.path.is_relative_to(Path(__file__).parent):
                if item.get_closest_marker("slow"):
                    item.add_marker(pytest.mark.skip(reason="long benchmarks are off (--benchmark-enable)"))
                item.add_marker(pytest.mark.slow)


@pytest.fixture
def measured(request: pytest.FixtureRequest) -> None:
    """For what takes minutes, and shows nothing unless it is measured."""
    if not request.config.getoption("benchmark_enable"):
        pytest.skip("benchmarks are off (--benchmark-enable)")


@pytest.fixture(autouse=True)
def _memory(request: pytest.FixtureRequest) -> Iterator[None]:
    """`memory_mb` of a benchmark: by how much the process grew at most, above what it held when the test began.

    What had been freed, and was kept by the C library, is taken again without being counted. Only of Linux.
    """
    peak = Path("/proc/self/clear_refs")
    if "benchmark" not in request.fixturenames or not peak.exists():
        yield
        return
    benchmark = request.getfixturevalue("benchmark")
    peak.write_text("5")  # the peak begins anew (proc(5))
    before = held("VmRSS")
    yield
    benchmark.extra_info.setdefault("memory_mb", round((held("VmHWM") - before) / 1024, 1))


def held(what: str) -> int:
    """A line of this process's status, kB."""
    return int(re.findall(rf"^{what}:\s*(\d+) kB", Path("/proc/self/status").read_text(), re.MULTILINE)[0])


@pytest.fixture(scope="session")
def ten_thousand_runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Finished runs: sweeps of a thousand jobs, over two settings and ten seeds. To be left as they are."""
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
