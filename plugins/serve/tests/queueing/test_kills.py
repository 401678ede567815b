"""A real service with real runs, killed with SIGKILL at any instant: it comes back with nothing lost and nothing run twice."""

from __future__ import annotations

import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from queue_for_tests import free_port, until

from omnilab.runner.run_folder import DONE, find_runs
from omnilab.runner.sweeps import load_sweep

WORLD = Path(__file__).parents[4] / "tests/box_world.yaml"
RUN = [
    "experiment=quickstart", "study.query_count=6", "study.step_m=1.0", "sensor.world=box.yaml", "sensor.size=64",
    "sensor.samples=1", "descriptor=hog", "~sinks.rerun", "~sinks.mcap", "cache=off",
]  # fmt: skip
PATIENCE_S = 800.0  # for real runs, on a machine that does much else
TOKEN = re.compile(r'"X-CSRF-Token": "([^"]+)"')


class Service:
    """`omnilab serve` in a folder, which can be killed and started again."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.port = folder, free_port()
        self.client = httpx.Client(base_url=f"http://127.0.0.1:{self.port}", timeout=60)
        self.process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        words = [sys.executable, "-m", "omnilab", "serve", "--logs", "logs", "--port", str(self.port)]
        with (self.folder / "serve.txt").open("ab") as out:
            self.process = subprocess.Popen(words, cwd=self.folder, stdout=out, stderr=out, start_new_session=True)
        until(self.answers)
        token = TOKEN.search(self.client.get("/queue").text.replace("&#34;", '"'))
        assert token is not None
        self.client.headers["X-CSRF-Token"] = token[1]

    def answers(self) -> bool:
        assert self.process is not None
        assert self.process.poll() is None, (self.folder / "serve.txt").read_text()
        try:
            return self.client.get("/queue").status_code == 200
        except httpx.TransportError:
            return False

    def kill(self) -> None:
        assert self.process is not None
        self.process.kill()
        self.process.wait()

    def submit(self, *overrides: str) -> str:
        answer = self.client.post("/api/submissions", json={"overrides": [*RUN, *overrides]})
        assert answer.status_code == 201, answer.text
        return str(answer.json()["id"])

    def submissions(self) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = self.client.get("/api/submissions").json()
        return found

    def states(self) -> set[str]:
        return {one["state"] for one in self.submissions()}


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    shutil.copy(WORLD, tmp_path / "box.yaml")
    found = Service(tmp_path)
    yield found
    found.client.close()
    found.kill()
    for folder in Path("/proc").glob("[0-9]*"):  # what it has left running
        try:
            if (folder / "cwd").readlink() == tmp_path:
                os.kill(int(folder.name), signal.SIGKILL)
        except OSError:
            continue


def seeds(logs: Path) -> list[int]:
    """Of the runs that are done, each of which was begun once."""
    runs = find_runs(logs)
    assert [run.state for run in runs] == [DONE] * len(runs)
    return sorted(run.config["seed"] for run in runs)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_killed_service_comes_back_to_what_ran_and_waited(service: Service) -> None:
    service.start()
    for seed in (1, 2):
        service.submit(f"seed={seed}")
    until(lambda: any((service.folder / "logs").glob("quickstart/*/status.json")), PATIENCE_S)
    service.kill()
    service.start()
    assert {"running", "queued"} >= service.states() - {DONE}
    until(lambda: service.states() == {DONE}, PATIENCE_S)
    assert seeds(service.folder / "logs") == [1, 2]


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_nothing_is_lost_or_run_twice_at_three_random_kills(service: Service) -> None:
    chance = random.Random(4)
    service.start()
    for seed in range(3):
        service.submit(f"seed={seed}")
    for _ in range(3):
        time.sleep(chance.uniform(0.0, 4.0))
        service.kill()
        service.start()
    until(lambda: service.states() == {DONE}, PATIENCE_S)
    assert len(service.submissions()) == 3
    assert [one["attempt"] for one in service.submissions()] == [1] * 3
    assert seeds(service.folder / "logs") == list(range(3))


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_sweep_that_went_down_with_the_machine_goes_on(service: Service) -> None:
    service.start()
    identity = service.submit("seed=1,2,3")
    sweeps = service.folder / "logs" / "quickstart"
    until(lambda: any(sweeps.glob("*/0/metrics.csv")), PATIENCE_S)
    (folder,) = (jobs.parent for jobs in sweeps.glob("*/jobs.jsonl"))
    leader = service.client.get(f"/api/submissions/{identity}").json()
    assert leader["state"] == "running"
    service.kill()
    record = (service.folder / "logs/.queue" / f"{identity}.json").read_text()
    os.killpg(int(re.findall(r'"pid": (\d+)', record)[0]), signal.SIGKILL)
    service.start()
    until(lambda: service.states() == {DONE}, PATIENCE_S)
    (one,) = service.submissions()
    assert (one["attempt"], one["path"]) == (2, f"quickstart/{folder.name}")
    assert [job.state for job in load_sweep(folder).jobs] == [DONE] * 3


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_sweep_that_was_killed_elsewhere_goes_on_from_here(service: Service) -> None:
    service.start()
    folder = service.folder / "logs/quickstart/sweep"
    words = [sys.executable, "-m", "omnilab", "-m", *RUN, "seed=1,2", "hydra.sweep.dir=logs/quickstart/sweep"]
    leader = subprocess.Popen(words, cwd=service.folder, stderr=subprocess.DEVNULL, start_new_session=True)
    until((folder / "0/metrics.csv").exists, PATIENCE_S)
    refused = service.client.post("/api/submissions/resume", json={"path": "quickstart/sweep"})
    assert refused.status_code == 422
    assert "is still running" in refused.text
    leader.kill()
    leader.wait()
    assert service.client.post("/api/submissions/resume", json={"path": "quickstart/sweep"}).status_code == 201
    until(lambda: service.states() == {DONE}, PATIENCE_S)
    assert [job.state for job in load_sweep(folder).jobs] == [DONE] * 2
