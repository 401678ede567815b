"""The whole story, with a service of its own process: an experiment is started, watched, seen, compared; a killed sweep goes on."""

from __future__ import annotations

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from omnilab.client import Client, SubmissionRequest
from omnilab.runner.run_folder import DONE, find_runs, load_run
from omnilab.runner.sweeps import load_sweep

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

SMALL = [
    "experiment=quickstart",
    "seed=1,2,3",
    "study.query_count=6",
    "study.step_m=1.0",
    "sensor.size=64",
    "cache=off",
]
WATCHED = {"study.query_count": "300", "sensor.size": "96"}  # long enough for its bar to be seen on its way
OMNILAB = [sys.executable, "-m", "omnilab"]


def until(happens: Callable[[], object], timeout_s: float = 240) -> object:
    """What it returns once that is true."""
    end = time.monotonic() + timeout_s
    while not (found := happens()):
        assert time.monotonic() < end, "it has not happened in time"
        time.sleep(0.1)
    return found


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder to work in, with a sweep of three jobs that was killed, all its processes, after the first had ended."""
    folder = tmp_path_factory.mktemp("home")
    sweep = folder / "logs" / "sweep"
    process = subprocess.Popen(
        [*OMNILAB, "-m", *SMALL, "hydra.sweep.dir=logs/sweep"],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    until((sweep / "1" / "status.json").exists)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    return folder


@pytest.fixture(scope="module")
def address(home: Path) -> Iterator[str]:
    """The address of `omnilab serve` there."""
    with subprocess.Popen([*OMNILAB, "serve", "--port", "0"], cwd=home, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr
        found = re.search(r"http://127\.0\.0\.1:\d+", process.stderr.readline())
        assert found
        yield found[0]
        process.send_signal(signal.SIGINT)
        assert process.wait(20) in {0, 130}


def compared(home: Path, runs: list[Path]) -> dict[str, Any]:
    """What the command line says of runs."""
    done = subprocess.run(
        [*OMNILAB, "compare", *map(str, runs), "--json"], cwd=home, capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)  # type: ignore[no-any-return]


def check_resumed(sweep: Path, before: tuple[str, int]) -> None:
    """The sweep is whole, and its first job is the one of before."""
    assert [job.state for job in load_sweep(sweep).jobs] == [DONE] * 3
    with (sweep / "summary.csv").open(newline="") as file:
        assert [row["status"] for row in csv.DictReader(file)] == [DONE] * 3
    assert first_job(sweep) == before


def first_job(sweep: Path) -> tuple[str, int]:
    return load_run(sweep / "0").manifest["id"], (sweep / "0" / "metrics.csv").stat().st_mtime_ns


def test_in_a_browser(home, address, tab):
    """Started from the form, watched, seen in the viewer, compared with a second run."""
    tab.goto(address)
    tab.get_by_role("link", name="New experiment").click()
    tab.get_by_role("link", name=re.compile("^quickstart")).click()
    tab.get_by_role("textbox", name="query_count").fill(WATCHED["study.query_count"])
    tab.locator('[data-setting="sensor.size"]').evaluate("field => field.closest('details').open = true")
    tab.locator('[id="set-sensor.size"]').fill(WATCHED["sensor.size"])
    tab.locator("#command", has_text="sensor.size=96").wait_for()
    assert (
        tab.locator("#command").text_content() == "omnilab experiment=quickstart study.query_count=300 sensor.size=96"
    )
    tab.get_by_role("button", name="Start").click()

    tab.wait_for_url("**/queue")  # its bar moves
    bars = tab.locator("main progress")
    bars.first.wait_for(timeout=120_000)
    lengths: set[float] = set()
    while found := bars.evaluate_all("bars => bars.map(bar => bar.value)"):
        lengths.update(found)
        tab.wait_for_timeout(50)
    assert lengths - {0.0, 1.0}
    tab.locator("main .state.done").first.wait_for(timeout=120_000)

    tab.locator("main").get_by_role("link", name="Run", exact=True).first.click()  # and it is done
    tab.wait_for_url("**/runs/quickstart/**")
    assert tab.locator("h1").text_content() == "quickstart"
    (run,) = [run for run in find_runs(home / "logs") if run.folder.parent.name == "quickstart"]
    assert run.state == DONE
    assert run.config["study"]["query_count"] == 300
    path = run.folder.relative_to(home / "logs").as_posix()

    tab.set_viewport_size({"width": 700, "height": 450})  # it is drawn without a graphics card
    tab.goto(f"{address}/viewer/{path}")
    colours = until(lambda: many_colours(tab.screenshot()), 120)  # the room
    assert colours

    second = Client(address).submit(
        SubmissionRequest(["experiment=quickstart", "descriptor=hog", "study.query_count=30", "sensor.size=96"])
    )
    second = Client(address).wait(second.id, 240)
    tab.goto(address)
    for row in (path, str(second.path)):
        tab.get_by_label(f"Compare {row}").check()
    tab.get_by_role("link", name="Compare", exact=True).last.click()
    tab.wait_for_url("**/compare?**")
    tab.get_by_role("heading", name="Metrics").wait_for(timeout=120_000)
    shown = tab.locator("main").inner_text()
    expected = compared(home, [home / "logs" / path, home / "logs" / str(second.path)])
    for configuration in expected["configurations"]:
        assert configuration["metrics"]["position_error_median"]["text"] in shown


def many_colours(png: bytes) -> bool:
    """Whether a picture of the viewer shows more than its own grey: hues of the room's furniture."""
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    hue, saturation, value = np.moveaxis(cv2.cvtColor(image, cv2.COLOR_BGR2HSV), 2, 0)
    vivid = hue[(saturation > 80) & (value > 60)]
    return len(vivid) > 0.05 * hue.size and len(np.unique(vivid)) > 60


def test_by_the_api(home, address):
    """The same by the client; and a killed sweep is resumed, as test_sweep_page.py does on its page."""
    client = Client(address)
    asked = SubmissionRequest(["experiment=quickstart", "study.step_m=0.8", "study.query_count=400"])
    assert client.check(asked).experiment == "quickstart"
    first = client.submit(asked)
    second = client.submit(
        SubmissionRequest(["experiment=quickstart", "descriptor=hog", *asked.overrides[1:]], priority=-1)
    )
    fractions = set()
    while client.submission(first.id).state in {"queued", "running"}:
        path = client.submission(first.id).path
        fractions |= {
            run.progress.fraction for run in client.runs("state:running").runs if run.path == path and run.progress
        }
        time.sleep(0.1)
    assert fractions - {0.0, 1.0}
    first, second = client.submission(first.id), client.wait(second.id, 240)
    assert (first.state, second.state) == (DONE, DONE)
    folders = [home / "logs" / str(one.path) for one in (first, second)]
    assert client.run(str(first.path)).metrics == load_run(folders[0]).metrics
    for what in ("configurations", "metrics", "paired", "error_curves"):
        assert client.compare([str(first.path), str(second.path)])[what] == compared(home, folders)[what]

    sweep = home / "logs" / "sweep"
    before = first_job(sweep)
    assert client.sweep("sweep").counts[DONE] == 1
    assert client.wait(client.resume("sweep").id, 240).state == DONE
    check_resumed(sweep, before)
    assert [job.state for job in client.sweep("sweep").jobs] == [DONE] * 3
