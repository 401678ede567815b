"""Draws the pictures of docs/service.md, with a service and a browser of its own: uv run python docs/service_pictures.py"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from playwright.sync_api import Page, sync_playwright

from omnilab.client import Client, SubmissionRequest

PICTURES = Path(__file__).parent / "service"
OMNILAB = [sys.executable, "-m", "omnilab"]
RUNS = [  # what the pages show
    ["experiment=quickstart"],
    ["experiment=quickstart", "descriptor=hog"],
    ["experiment=quickstart", "descriptor=gist"],
    ["-m", "experiment=quickstart", "descriptor=radon,hog", "study.step_m=0.4,0.6,0.8", "seed=0,1", "hydra.sweep.dir=logs/steps"],
]  # fmt: skip
QUEUED = [
    ["experiment=quickstart", "descriptor=fourier_signature"],
    ["experiment=quickstart", "localizer=bayes_filter"],
    ["experiment=quickstart", "seed=1,2,3,4"],
]
VIEWER_S = 20  # that a software renderer takes to draw a recording


def draw(tab: Page, address: str, client: Client) -> None:
    """Each page, as its first reader sees it."""

    def take(name: str, path: str, seconds: float = 1.0, height: int = 900) -> None:
        tab.set_viewport_size({"width": 1400, "height": height})
        tab.goto(address + path)
        tab.wait_for_timeout(1000 * seconds)
        tab.screenshot(path=PICTURES / f"{name}.png")

    singles = [run.path for run in client.runs("state:done").runs if run.sweep is None]
    take("runs", "/")
    take("run", f"/runs/{singles[-1]}", VIEWER_S, 1500)
    take("viewer", f"/viewer/{singles[-1]}", VIEWER_S)
    compared = "&".join(f"run={path}" for path in singles[::-1])
    take("compare", f"/compare?{compared}", 15, 1500)
    take("sweep", "/sweeps/steps?metric=position_error_median", 15, 1300)
    take("sweeps", "/sweeps", height=420)
    take("recipes", "/new", 3)
    take("new", "/new?experiment=quickstart", 3)
    take("all_components", "/components", 60)
    take("components", "/components/descriptor/radon", 2)
    for overrides in QUEUED:
        client.submit(SubmissionRequest(overrides))
    take("queue", "/queue", 12, 560)


def main() -> None:
    """Run what is shown, serve it, and look at it."""
    PICTURES.mkdir(exist_ok=True)
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    with TemporaryDirectory() as home, sync_playwright() as playwright:
        for words in RUNS:
            subprocess.run([*OMNILAB, *words], cwd=home, check=True, capture_output=True)
        browser = playwright.chromium.launch(
            executable_path=chromium,
            args=["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
        )
        with subprocess.Popen(
            [*OMNILAB, "serve", "--port", "0"], cwd=home, stderr=subprocess.PIPE, text=True
        ) as process:
            assert process.stderr
            address = re.findall(r"http://[\d.:]+", process.stderr.readline())[0]
            client = Client(address)
            draw(browser.new_context(color_scheme="light").new_page(), address, client)
            for one in client.submissions():
                if one.state in {"queued", "running"}:
                    client.cancel(one.id)
            process.terminate()
        browser.close()


if __name__ == "__main__":
    main()
