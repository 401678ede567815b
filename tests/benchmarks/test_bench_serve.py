"""`omnilab serve` over ten thousand runs, as a process of its own: pages, updates, idling, and what it costs a running experiment."""

from __future__ import annotations

import itertools
import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest

pytestmark = pytest.mark.slow
GROUP = "serve: ten thousand runs"
ALONE = "no other service reads these folders"
RUNS = 10_000  # as of the fixture
SCRIPT = Path(sys.executable).with_name("omnilab")
TICKS = os.sysconf("SC_CLK_TCK")
IDLE_S, PAIRS = 30, 3
EXPERIMENT = [
    "experiment=quickstart",
    "study.step_m=0.5",
    "study.query_count=60",
    "sensor.size=128",
    "cache=off",
    "~sinks",
]


@contextmanager
def serving(logs: Path, runs: int) -> Iterator[tuple[httpx.Client, int]]:
    """A service that has read this many runs: a client, and the number of its process."""
    words = [SCRIPT, "serve", "--logs", logs, "--port", "0"]
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        address = re.search(r"http://\S+", process.stderr.readline())
        assert address is not None
        try:
            with httpx.Client(base_url=address[0], timeout=120) as client:
                while client.get("/api/runs", params={"limit": 0}).json()["total"] < runs:
                    time.sleep(0.05)
                yield client, process.pid
        finally:
            process.terminate()


@pytest.fixture(scope="module")
def logs(ten_thousand_runs: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The runs, with an index of them that an earlier start has left."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        with serving(ten_thousand_runs, RUNS):
            pass
        yield ten_thousand_runs


@pytest.fixture(scope="module")
def served(logs: Path) -> Iterator[tuple[httpx.Client, int]]:
    with serving(logs, RUNS) as found:
        time.sleep(10)  # until it has looked at the sweeps, too
        yield found


@pytest.mark.benchmark(group=GROUP, timer=time.perf_counter)
def test_a_restart(benchmark, logs):
    def restarted():
        with serving(logs, RUNS):
            pass

    benchmark.extra_info["no_peer"] = ALONE
    benchmark.pedantic(restarted, rounds=3)


@pytest.mark.benchmark(group=GROUP, timer=time.perf_counter)
def test_the_first_page(benchmark, served):
    client, _ = served
    page = benchmark.pedantic(client.get, ("/",), rounds=10)
    assert page.text.count("<tr id=") == 100


@pytest.mark.benchmark(group=GROUP, timer=time.perf_counter)
def test_a_search(benchmark, served):
    """Each another, so that no answer is kept."""
    client, _ = served
    numbers = itertools.count()
    benchmark.pedantic(
        lambda: client.get(
            "/api/runs", params={"q": f"state:done angles>{next(numbers)} -seed:3", "sort": "nearest_rate"}
        ),
        rounds=10,
    )


@pytest.mark.benchmark(group=GROUP, timer=time.perf_counter)
def test_an_update(benchmark, served, logs):
    """From the event that says that there is a new run to the rows with it."""
    client, _ = served
    numbers = itertools.count()
    with client.stream("GET", "/events") as events:
        lines = events.iter_lines()

        def another():
            name = f"2030-01-01_00-00-{next(numbers):02}-abcdef"  # the newest
            shutil.copytree(logs / "sweep0/0", logs / f"new/{name}")
            while next(lines) != "data: runs":
                pass
            return (name,), {}

        def updated(name):
            assert name in client.get("/parts/runs").text

        benchmark.pedantic(updated, setup=another, rounds=8)
    shutil.rmtree(logs / "new")


def processor_s(pid: int) -> float:
    """Processor time that a process has taken so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


@pytest.mark.benchmark(group=GROUP, timer=time.perf_counter)
def test_idling(benchmark, measured, served):
    _, pid = served
    before_s = processor_s(pid)
    benchmark.pedantic(time.sleep, (IDLE_S,), rounds=1)
    status = Path(f"/proc/{pid}/status").read_text()
    resident_mb = int(re.search(r"VmRSS:\s*(\d+) kB", status)[1]) / 1024
    benchmark.extra_info |= {
        "of a core": f"{(processor_s(pid) - before_s) / IDLE_S:.2%}", "resident": f"{resident_mb:.0f} MB"
    }  # fmt: skip
    sys.stderr.write(f"\n{benchmark.extra_info}\n")


def experiment_s(logs: Path) -> float:
    """Processor time of one experiment."""
    process = subprocess.Popen([SCRIPT, *EXPERIMENT, f"logs={logs}"], stdout=subprocess.DEVNULL)
    _, code, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(code)
    assert process.returncode == 0
    return used.ru_utime + used.ru_stime


@pytest.mark.benchmark(group="serve: an experiment alone, then watched", timer=time.perf_counter)
def test_what_it_costs_an_experiment(benchmark, measured, tmp_path):
    """Alone and watched in turns; what is watched is a page that shows the run."""
    experiment_s(tmp_path)  # fills the caches of the disk

    def pair():
        alone = experiment_s(tmp_path)
        with serving(tmp_path, 1) as (client, _), watching(client):
            return alone, experiment_s(tmp_path)

    benchmark.extra_info["no_peer"] = "the experiment alone is in it"
    pairs = [pair() for _ in range(PAIRS - 1)] + [benchmark.pedantic(pair, rounds=1)]
    alone, watched = (sorted(column)[len(pairs) // 2] for column in zip(*pairs, strict=True))
    benchmark.extra_info |= {"more": f"{watched / alone - 1:+.1%}", "pairs": json.dumps(pairs)}
    sys.stderr.write(f"\n{benchmark.extra_info}\n")


@contextmanager
def watching(client: httpx.Client) -> Iterator[None]:
    """A client that loads what is shown whenever it is told to, as a page does: in a process of its own."""
    script = (
        "import sys, httpx\n"
        "with httpx.Client(base_url=sys.argv[1], timeout=60) as client:\n"
        "    with client.stream('GET', '/events', timeout=None) as events:\n"
        "        for line in events.iter_lines():\n"
        "            if line.startswith('data: run'):\n"
        "                client.get('/parts/runs')\n"
    )
    with subprocess.Popen([sys.executable, "-c", script, str(client.base_url)]) as process:
        try:
            yield
        finally:
            process.kill()
