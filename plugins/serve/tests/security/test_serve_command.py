"""The command `omnilab serve`: where it listens, what it says, how it ends."""

from __future__ import annotations

import http.client
import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, suppress
from pathlib import Path

import httpx
import pytest

from omnilab.errors import ConfigError
from omnilab_serve.serve_command import serve as command

URL = re.compile(r"the page is at (http://\S+)")


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., tuple[subprocess.Popen[str], str]]]:
    """Starts the command in a process of its own; gives it and the address that it prints."""
    started = []

    def begin(*words: str, **environment: str) -> tuple[subprocess.Popen[str], str]:
        given = ["--port", "0", "--logs", str(tmp_path / "logs"), *words]
        process = subprocess.Popen(
            [sys.executable, "-m", "omnilab", "serve", *given],
            stderr=subprocess.PIPE, text=True, env=os.environ | environment, start_new_session=True,
        )  # fmt: skip
        started.append(process)
        assert process.stderr
        found = URL.match(line := process.stderr.readline())
        assert found, line + process.stderr.read()
        return process, found[1]

    yield begin
    for process in started:
        process.kill()
        process.communicate()


def addresses(process: int) -> set[str]:
    """The addresses at which a process listens, in the hexadecimals of /proc."""
    inodes = set()
    for file in Path(f"/proc/{process}/fd").iterdir():
        with suppress(FileNotFoundError):  # it was closed meanwhile
            inodes.add(str(file.readlink()))
    rows = [line.split() for kind in ("tcp", "tcp6") for line in Path(f"/proc/net/{kind}").read_text().splitlines()[1:]]
    return {row[1].split(":")[0] for row in rows if row[3] == "0A" and f"socket:[{row[9]}]" in inodes}


def with_children(process: int) -> list[int]:
    """A process and all that it started."""
    found = [process]
    for one in found:  # which grows
        with suppress(FileNotFoundError, ProcessLookupError):  # it has ended
            for thread in Path(f"/proc/{one}/task").iterdir():
                found += map(int, (thread / "children").read_text().split())
    return found


@pytest.mark.slow
def test_rerun_listens_on_this_machine_alone_while_its_viewer_is_unpacked(start, finished_runs, tmp_path):
    process, url = start("--logs", str(finished_runs), XDG_CACHE_HOME=str(tmp_path))
    (run, *_) = httpx.get(f"{url}api/runs").json()["runs"]
    seen: list[set[str]] = []
    with ThreadPoolExecutor(1) as pool:
        page = pool.submit(httpx.get, f"{url}viewer/{run['path']}", timeout=120)
        while not page.done():
            for one in with_children(process.pid)[1:]:
                with suppress(FileNotFoundError, PermissionError):
                    seen.append(addresses(one))
    assert page.result().status_code == 200
    assert set().union(*seen) == {"0100007F"}
    assert addresses(process.pid) == {"0100007F"}


def test_it_listens_on_this_machine_alone_and_ends_by_ctrl_c_with_open_streams(start):
    process, url = start()
    assert httpx.get(url).status_code == 200
    assert addresses(process.pid) == {"0100007F"}
    port = int(url.split(":")[2].strip("/"))
    with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=60)) as stream:
        stream.request("GET", "/events")
        with stream.getresponse() as answer:
            process.send_signal(signal.SIGINT)
            assert answer.read() == b""  # to its end
    _, said = process.communicate(timeout=60)
    assert process.returncode == 0
    assert said == "omnilab: the page has ended; runs that it started go on\n"


def test_others_come_in_with_a_token_which_is_made_and_printed(start):
    _, url = start("--host", "0.0.0.0")
    address, token = url.split("login?token=")
    assert len(token) >= 32
    here = re.sub(r"//[^:]*:", "//127.0.0.1:", address)
    assert httpx.get(here).status_code == 401
    with httpx.Client() as browser:
        browser.get(f"{here}login", params={"token": token})
        assert browser.get(here).status_code == 200


def test_the_token_may_come_from_the_environment(start):
    _, url = start(OMNILAB_TOKEN="sixteen-letters-1")
    assert url.endswith("login?token=sixteen-letters-1")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--token", "short"], "the token has 5 characters; give 16 or more"),
        (["--token", "ééééééééééééééééé"], "of ASCII"),
        (["--port", "70000"], "--port 70000 is no port"),
        (["--port", "0", "--host", "192.0.2.1"], "'192.0.2.1' is no address of this machine"),
        (["--port", "0", "--host", "no such host"], "'no such host' is no address of this machine"),
        (["--workers", "0"], "--workers 0 would run nothing"),
        (["--inputs", "/no/such/folder"], "--inputs /no/such/folder is no folder"),
    ],
)
def test_what_cannot_be_is_one_sentence(words, sentence, tmp_path):
    with pytest.raises(ConfigError, match=re.escape(sentence)):
        command(["--logs", str(tmp_path / "logs"), *words])


def test_a_port_that_is_taken_is_one_sentence(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ConfigError, match=f"port {port} is taken"):
            command(["--logs", str(tmp_path / "logs"), "--port", str(port)])


def test_a_bug_shows_its_traceback_on_the_terminal_and_not_to_the_client(serve, monkeypatch, capsys):
    served = serve()
    monkeypatch.setattr(served.app.state.service.index, "search", lambda *_, **__: 1 / 0)
    for path in ("/", "/parts/runs"):
        answer = served.client.get(path)
        assert answer.status_code == 500
        assert answer.text == ("that is a mistake in omnilab, not yours; its traceback is on the service's terminal\n")
        assert "default-src 'none'" in answer.headers["content-security-policy"]
    assert "ZeroDivisionError" in capsys.readouterr().err
