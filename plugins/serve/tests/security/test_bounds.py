"""What requests may cost."""

from __future__ import annotations

import http.client
import json
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager

from omnilab_serve.pages import events
from omnilab_serve.security import bodies, connections, gate


def raw(served, request: bytes, wait_s: float = 15) -> bytes:
    """What the service answers to these bytes."""
    with socket.create_connection(("127.0.0.1", served.settings.port), timeout=wait_s) as connection:
        connection.sendall(request)
        try:
            return connection.recv(65536)
        except ConnectionResetError:  # what it has not read ends the connection
            return b""


@contextmanager
def streams(served, number: int) -> Iterator[None]:
    """Event streams that are open."""
    with ExitStack() as opened:
        for _ in range(number):
            connection = opened.enter_context(
                closing(http.client.HTTPConnection("127.0.0.1", served.settings.port, timeout=20))
            )
            connection.request("GET", "/events")
            opened.enter_context(connection.getresponse())
        until(lambda: served.app.state.service.events.count == number)
        yield


def until(condition) -> None:
    deadline = time.monotonic() + 30
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_body_that_is_too_large_is_refused(serve):
    served = serve()
    head = f"POST /api/submissions HTTP/1.1\r\nHost: localhost\r\nX-CSRF-Token: {served.app.state.csrf}\r\n"
    size = f"Content-Length: {bodies.MOST_BYTES + 1}\r\n\r\n"
    assert b"413" in raw(served, (head + size).encode()).split(b"\r\n")[0]
    chunk = b"%x\r\n%b\r\n" % (bodies.MOST_BYTES // 2, b" " * (bodies.MOST_BYTES // 2))
    chunked = (head + "Transfer-Encoding: chunked\r\n\r\n").encode() + chunk * 2 + b"5\r\n     \r\n"
    assert b"413" in raw(served, chunked).split(b"\r\n")[0]


def test_a_body_that_does_not_come_is_waited_for_so_long_and_no_longer(serve, monkeypatch):
    monkeypatch.setattr(bodies, "MOST_S", 0.3)
    served = serve()
    head = f"POST /api/submissions HTTP/1.1\r\nHost: localhost\r\nX-CSRF-Token: {served.app.state.csrf}\r\n"
    assert b"408" in raw(served, (head + "Content-Length: 5\r\n\r\n12").encode()).split(b"\r\n")[0]


def test_a_body_of_the_right_size_arrives_whole(serve):
    served = serve()
    overrides = ["experiment=quickstart", *(f"seed={i}" for i in range(20_000))]
    answer = served.client.post("/api/check", content=json.dumps({"overrides": overrides}))
    assert answer.status_code in {200, 404, 405, 422}


def test_long_addresses_and_headers_are_refused(serve):
    served = serve()
    assert served.client.get("/?q=" + "x" * gate.MOST_URL).status_code == 414
    huge = f"GET / HTTP/1.1\r\nHost: localhost\r\nX: {'x' * 200_000}\r\n\r\n".encode()
    assert raw(served, huge)[:12] in {b"HTTP/1.1 400", b""}
    assert served.client.get("/api/session").status_code == 200


def test_a_request_that_does_not_come_whole_gives_its_place_back(serve, monkeypatch):
    monkeypatch.setattr(connections, "REQUEST_S", 0.2)
    served = serve()
    whole = b"GET /api/session HTTP/1.1\r\nHost: localhost\r\n\r\n"
    for begun in (b"", b"GET / HT", whole + whole[:20]):
        with socket.create_connection(("127.0.0.1", served.settings.port), timeout=20) as connection:
            connection.sendall(begun)
            assert b"".join(iter(lambda: connection.recv(4096), b"")).startswith(
                b"HTTP/1.1 200" if whole in begun else b""
            )


def test_event_streams_have_a_number(serve, monkeypatch):
    monkeypatch.setattr(events, "MOST_STREAMS", 3)
    served = serve()
    with streams(served, 3):
        answer = served.client.get("/events")
        assert answer.status_code == 503
        assert "3 pages watch already" in answer.text
    until(lambda: served.app.state.service.events.count == 0)
