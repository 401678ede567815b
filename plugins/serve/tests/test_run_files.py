"""Files of runs over HTTP: what is sent, as what, and what is not, whoever wrote the folder."""

from __future__ import annotations

import asyncio
import http.client
import os
import shutil
from concurrent.futures import ThreadPoolExecutor

import pytest

from omnilab_serve.pages.run import OpenFileResponse
from omnilab_serve.run_details.files import open_file

PICTURE = b"\x89PNG\r\n\x1a\n and what follows"
PAGE = b"<!doctype html><script>alert(1)</script>"


@pytest.fixture
def logs(tmp_path, finished_runs):
    """Logs with one run of its own, called grid/a, and something outside that is nobody's business."""
    run = next(file.parent for file in finished_runs.glob("quickstart/*/status.json"))
    logs = tmp_path / "logs"
    shutil.copytree(run, logs / "grid" / "a")
    (tmp_path / "secret.txt").write_text("a secret")
    (logs / "loose.txt").write_text("of no run")
    return logs


def raw(served, target: str) -> tuple[int, bytes]:
    """What the service answers to exactly this path, which clients would tidy up."""
    connection = http.client.HTTPConnection("127.0.0.1", served.settings.port, timeout=20)
    try:
        connection.putrequest("GET", target, skip_host=False)
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()


def test_pictures_and_texts_are_shown_and_all_else_is_saved(serve, logs):
    run = logs / "grid" / "a"
    (run / "picture.png").write_bytes(PICTURE)
    (run / "page.html").write_bytes(PAGE)
    (run / "page.svg").write_bytes(b"<svg xmlns='http://www.w3.org/2000/svg'><script>alert(1)</script></svg>")
    (run / "disguised.png").write_bytes(PAGE)
    (run / "notes.txt").write_bytes(PAGE)
    client = serve(logs=logs).client
    kinds = {
        "picture.png": "image/png",
        "notes.txt": "text/plain; charset=utf-8",
        "run.log": "text/plain; charset=utf-8",
    }
    for name in ("picture.png", "notes.txt", "run.log", "page.html", "page.svg", "disguised.png", "run.rrd"):
        answer = client.get(f"/files/grid/a/{name}")
        assert answer.status_code == 200
        assert answer.content == (run / name).read_bytes()
        assert answer.headers["content-type"] == kinds.get(name, "application/octet-stream")
        assert answer.headers.get("content-disposition", "").startswith("attachment") is (name not in kinds)
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["content-security-policy"] == "sandbox; default-src 'none'"


@pytest.mark.parametrize(
    "target",
    [
        "/files/grid/a/../../../secret.txt", "/files/grid/a/..%2f..%2f..%2fsecret.txt", "/files/../secret.txt",
        "/files/grid/a/%2e%2e/%2e%2e/%2e%2e/secret.txt", "/files/%2fetc%2fpasswd", "/files//etc/passwd",
        "/files/grid/a//etc/passwd", "/files/grid/a/%2fetc%2fpasswd", "/files/grid/a/link.txt", "/files/grid/a/inner/secret.txt",
        "/files/grid/a/pipe", "/files/grid/a/inside", "/files/grid/a", "/files/grid/a/", "/files/grid", "/files/", "/files/loose.txt",
        "/files/grid/a/run.log%00.png", "/files/grid/a/missing.txt", "/files/grid/a/circle", "/files/grid/b/run.log/x",
        "/files/grid/a/x" + "y" * 5000,
    ],
)  # fmt: skip
def test_nothing_but_files_within_a_run_is_sent(serve, logs, target):
    run = logs / "grid" / "a"
    os.mkfifo(run / "pipe")
    (run / "inside").mkdir()
    (run / "link.txt").symlink_to(logs.parent / "secret.txt")
    (run / "inner").symlink_to(logs.parent)
    (run / "circle").symlink_to(run / "circle")
    status, content = raw(serve(logs=logs), target)
    assert status == 404
    assert b"a secret" not in content
    assert b"root:" not in content


def test_a_link_within_the_run_and_the_link_to_the_newest_are_followed(serve, logs):
    (logs / "grid" / "a" / "again.log").symlink_to("run.log")
    (logs / "latest").symlink_to("grid/a")
    client = serve(logs=logs).client
    whole = (logs / "grid" / "a" / "run.log").read_bytes()
    assert client.get("/files/grid/a/again.log").content == whole
    assert client.get("/files/latest/run.log").content == whole


def test_the_api_lists_files_and_gives_the_end_of_the_log(serve, logs):
    run = logs / "grid" / "a"
    (run / "inner").symlink_to("../a")
    (run / "run.log").write_text("".join(f"line {i}\n" for i in range(500)) + "\x1b[31mred\n")
    client = serve(logs=logs).client
    found = {file["name"]: file["size"] for file in client.get("/api/files/grid/a").json()}
    assert found == {file.name: file.stat().st_size for file in run.iterdir() if file.name != "inner"}
    tail = client.get("/api/log/grid/a", params={"lines": 2}).json()
    assert tail == {"lines": ["line 499", "\\x1b[31mred"], "size": (run / "run.log").stat().st_size, "cut": True}
    (run / os.fsdecode(b"odd\xff.png")).write_bytes(PICTURE)
    assert "odd\\udcff.png" in {file["name"] for file in client.get("/api/files/grid/a").json()}
    assert client.get("/runs/grid/a").status_code == 200
    assert client.get("/api/files/grid").status_code == 404
    assert client.get("/api/log/nowhere").status_code == 404


def test_a_file_is_closed_though_the_browser_is_gone_before_its_first_byte(tmp_path):
    (tmp_path / "a.txt").write_text("text")
    file = open_file(tmp_path / "a.txt")

    async def gone(*_):
        raise OSError("the connection is closed")

    response = OpenFileResponse(file, 4, {}, "text/plain")
    with ThreadPoolExecutor(1) as pool:  # which has no loop of a browser
        done = pool.submit(asyncio.run, response({"type": "http", "asgi": {"spec_version": "2.4"}}, gone, gone))
    assert "closed" in repr(done.exception()) or "ClientDisconnect" in repr(done.exception())
    assert file.closed
