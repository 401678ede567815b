"""Rerun's viewer from our own origin: unpacked once, whole or not at all, and seen in a browser that reaches no other host."""

from __future__ import annotations

import gzip
import os
import stat
import threading
from pathlib import Path

import cv2
import numpy as np
import pytest

from omnilab.errors import DataError
from omnilab_serve.security import Access
from omnilab_serve.viewer import WebViewer, web_viewer

NAMES = {"re_viewer.js": b"let wasm_bindgen", "re_viewer_bg.wasm": b"\0asm"}


def children() -> set[str]:
    """The command lines of Rerun's programs that this process has started and that still live."""
    found = set()
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = status.read_text().rpartition(")")[2].split()[1]
            command = (status.parent / "cmdline").read_text()
        except (OSError, IndexError):  # it has ended meanwhile
            continue
        if parent == str(os.getpid()) and "serve-web" in command:
            found.add(command)
    return found


def is_open(file: Path) -> bool:
    """Whether the service, which is in this process, reads a file."""
    return any(link.is_symlink() and link.readlink() == file for link in Path("/proc/self/fd").iterdir())


def program(folder: Path, text: str) -> Path:
    """A program that is called as Rerun's is."""
    file = folder / "rerun"
    file.write_text(f"#!/bin/sh\n{text}\n")
    file.chmod(0o700)
    return file


@pytest.mark.slow  # two viewers of 43 MB are compressed
def test_two_that_unpack_at_once_get_the_same_whole_files(tmp_path, monkeypatch):
    viewers = [WebViewer(tmp_path / "cache") for _ in range(2)]
    threads = [threading.Thread(target=viewer.ready) for viewer in viewers]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert children() == set()
    monkeypatch.setattr(web_viewer, "program", lambda: pytest.fail("it was unpacked again"))
    for name, begins in NAMES.items():
        kind, file = viewers[0].file(name)
        assert gzip.decompress(file.read_bytes()).startswith(begins)
        assert kind.name == name
    assert list((tmp_path / "cache").iterdir()) == [viewers[0].folder]
    assert stat.S_IMODE(viewers[0].folder.stat().st_mode) == 0o700


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("echo 'error: no such option' >&2; exit 2", "error: no such option"),
        ("exit 0", "it says nothing"),
        ("echo 'INFO Hosting a web-viewer at http://127.0.0.1:1 - connect' >&2; exec sleep 60", "refused"),
    ],
)
def test_a_viewer_that_cannot_be_unpacked_says_why_and_leaves_nothing(tmp_path, monkeypatch, text, why):
    monkeypatch.setattr(web_viewer, "program", lambda: program(tmp_path, text))
    viewer = WebViewer(tmp_path / "cache")
    with pytest.raises(DataError, match=why):
        viewer.ready()
    assert list((tmp_path / "cache").iterdir()) == []
    assert children() == set()


def test_the_page_says_why_there_is_no_viewer(serve, finished_runs, tmp_path, monkeypatch):
    monkeypatch.setattr(web_viewer, "program", lambda: program(tmp_path, "echo it is broken >&2"))
    run = next(finished_runs.glob("quickstart/*/run.rrd")).parent
    answer = serve(logs=finished_runs).client.get(f"/viewer/quickstart/{run.name}")
    assert answer.status_code == 422
    assert "did not serve its viewer (it is broken); install rerun-sdk anew" in answer.text


def floor_share(picture: bytes) -> float:
    """The share of pixels that have the colour of the room's wooden floor."""
    blue, green, red = np.moveaxis(cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR).astype(int), 2, 0)
    return float(np.mean((red > 1.15 * green) & (green > 1.2 * blue) & (red > 80)))


@pytest.fixture
def tab(tab):
    """A small one: each pixel of the viewer is drawn without a graphics card."""
    tab.set_viewport_size({"width": 700, "height": 450})
    return tab


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("unpacked")


@pytest.fixture
def serve_unpacked(serve, cache, monkeypatch):
    """Services that find the viewer as the first of them has unpacked it."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    return serve


def seen(tab) -> float:
    """The share of the floor in what the viewer shows, once there is some."""
    tab.locator("#viewer-state").wait_for(state="hidden", timeout=120_000)
    while (share := floor_share(tab.locator("canvas").screenshot(timeout=120_000))) < 0.03:
        tab.wait_for_timeout(500)
    return share


@pytest.mark.slow  # a browser that draws without a graphics card
def test_a_browser_shows_the_room_and_asks_no_other_host(serve_unpacked, tab, finished_runs):
    """Of a service that wants its token, by the cookie that the login page gives."""
    served = serve_unpacked(logs=finished_runs, token="a token of the tests")
    access = Access("a token of the tests", served.settings.port)
    tab.context.add_cookies([{"name": access.cookie_name, "value": access.cookie_value, "url": served.url}])
    asked, refused = [], []
    tab.on("request", lambda request: asked.append(request.url))
    tab.on(
        "console", lambda message: refused.append(message.text) if "Content Security Policy" in message.text else None
    )
    run = next(finished_runs.glob("quickstart/*/run.rrd")).parent
    tab.goto(f"{served.url}/viewer/quickstart/{run.name}")
    assert seen(tab) < 0.9
    assert f"{served.url}/recording/quickstart/{run.name}/run.rrd" in asked
    assert {url.split("/", 3)[2] for url in asked} == {f"127.0.0.1:{served.settings.port}"}
    assert refused == []  # the policy is the second wall
    policy = tab.request.get(tab.url).headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "connect-src 'self';" in policy
    held = tab.evaluate("performance.getEntriesByType('resource').map(entry => [entry.name, entry.encodedBodySize])")
    (size,) = (size for name, size in held if name.endswith(".wasm"))
    assert size < 20e6


@pytest.mark.slow  # as above
def test_the_room_is_seen_while_the_run_goes_on_and_after_it_was_killed(
    serve_unpacked, tab, finished_runs, tmp_path, runs_on
):
    """The recording ends within a message, as one that is being written, or was left by a kill."""
    run = tmp_path / "logs" / "grid" / "a"
    run.mkdir(parents=True)
    whole = next(finished_runs.glob("quickstart/*/run.rrd")).read_bytes()
    (run / "run.rrd").write_bytes(whole[: len(whole) * 2 // 3])
    process = runs_on(run)
    tab.goto(f"{serve_unpacked().url}/viewer/grid/a")
    seen(tab)
    assert is_open(run / "run.rrd")
    process.kill()
    while is_open(run / "run.rrd"):
        tab.wait_for_timeout(100)
    tab.wait_for_timeout(2000)  # in which it would show a failure
    assert seen(tab) < 0.9
    assert not tab.locator("#viewer-state").is_visible()


@pytest.mark.slow  # it is unpacked
def test_files_of_the_viewer_are_kept_by_browsers_and_are_of_this_version_alone(serve_unpacked):
    served = serve_unpacked()
    version = WebViewer().version
    for name, begins in NAMES.items():
        answer = served.client.get(f"/viewer-files/{version}/{name}")
        assert answer.content.startswith(begins)
        assert answer.headers["content-encoding"] == "gzip"
        assert "immutable" in answer.headers["cache-control"]
    assert served.client.get(f"/viewer-files/{version}/re_viewer_bg.wasm").headers["content-type"] == "application/wasm"
    for path in ("0.1/re_viewer.js", f"{version}/index.html", f"{version}/..%2f..%2fsecret", f"{version}/"):
        assert served.client.get(f"/viewer-files/{path}").status_code == 404
