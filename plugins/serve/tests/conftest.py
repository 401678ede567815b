"""A service of its own for each test, a client that knows its tokens, and a real browser."""

from __future__ import annotations

import fcntl
import os
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from omnilab.runner.cli import main
from omnilab_serve.app import create_app
from omnilab_serve.server import PageServer, listener
from omnilab_serve.settings import ServeSettings

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
ONLY_LOOPBACK = "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"  # as if there were no network
LAUNCH = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", ONLY_LOOPBACK]


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


class Served:
    """A service that listens at a port of its own, in a thread of the tests."""

    def __init__(self, settings: ServeSettings) -> None:
        self.settings = settings
        self.app = create_app(settings)
        self.server = PageServer(self.app, listener("127.0.0.1", settings.port))
        self.thread = threading.Thread(target=self.server.run, daemon=True)
        self.url = f"http://127.0.0.1:{settings.port}"
        self.client = httpx.Client(base_url=self.url, headers={"X-CSRF-Token": self.app.state.csrf}, timeout=30)

    def start(self) -> None:
        self.thread.start()
        while not self.server.started:
            assert self.thread.is_alive()
            time.sleep(0.02)

    def stop(self) -> None:
        self.client.close()
        self.server.should_exit = True
        self.thread.join(20)


@pytest.fixture
def serve(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[..., Served]]:
    """Starts a service: `serve()`, or `serve(logs=..., token=...)` with settings of its own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
    started = []

    def start(**settings: object) -> Served:
        given = {"logs": tmp_path / "logs", "port": free_port()} | settings
        Path(str(given["logs"])).mkdir(exist_ok=True)
        served = Served(ServeSettings(**given))  # type: ignore[arg-type]
        served.start()
        started.append(served)
        return served

    yield start
    for served in started:
        served.stop()


@pytest.fixture(scope="module")
def served_once(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A service for all tests of a module that change nothing: each one's processes import the plugins first."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        served = Served(ServeSettings(logs=tmp_path_factory.mktemp("logs"), port=free_port()))
        served.start()
        yield served
        served.stop()


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("no browser is there to look at pages with (Debian: apt-get install chromium)")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=LAUNCH)
        yield browser
        browser.close()


@pytest.fixture
def tab(browser: Browser) -> Iterator[Page]:
    """A page of a fresh profile, which fails the test if it meets a script error."""
    context = browser.new_context(viewport={"width": 1400, "height": 900})
    page, errors = context.new_page(), []
    page.on("pageerror", lambda error: errors.append(str(error)))
    yield page
    context.close()
    assert errors == []


RUN = ["experiment=quickstart", "study.query_count=6", "study.step_m=1.0", "sensor.size=64", "cache=off"]


@pytest.fixture(scope="session")
def finished_runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Logs with two small runs of quickstart, and a sweep of two jobs; to be copied by those that change it.

    They are made by the first process of the tests that wants them; each has a copy, for one service works on a folder of logs.
    """
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    with (shared / "served.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (shared / "served").is_dir():
            for words in ([*RUN, "seed=1"], [*RUN, "seed=2", "descriptor=hog"], ["-m", *RUN, "seed=3,4"]):
                with pytest.raises(SystemExit) as ended:
                    main([*words, f"logs={shared / 'being_served'}"])
                assert ended.value.code == 0
            (shared / "being_served").rename(shared / "served")
        return Path(shutil.copytree(shared / "served", base / "logs_served", symlinks=True))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Those that open a browser, start runs for the queue, or need runs that were really made, are slow."""
    for item in items:
        fixtures = set(getattr(item, "fixturenames", ()))
        if {"tab", "finished_runs"} & fixtures or item.path.parent.name == "queueing":
            item.add_marker(pytest.mark.slow)


RUNS_ON = """
import json, os, pathlib, sys
from omnilab.runner.run_folder.lock import RunLock
folder = pathlib.Path(sys.argv[1])
lock = RunLock.take(folder)
(folder / "status.json").write_text(json.dumps({"status": "running", "pid": os.getpid()}))
print("begun", flush=True)
sys.stdin.readline()
"""


@pytest.fixture
def runs_on() -> Iterator[Callable[[Path], subprocess.Popen[bytes]]]:
    """`runs_on(folder)`: a process that runs what is in a folder, as far as others see, until it is killed."""
    started = []

    def start(folder: Path) -> subprocess.Popen[bytes]:
        process = subprocess.Popen(
            [sys.executable, "-c", RUNS_ON, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )  # fmt: skip
        started.append(process)
        assert process.stdout is not None
        assert process.stdout.readline() == b"begun\n"
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()
