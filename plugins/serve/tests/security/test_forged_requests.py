"""Requests that pages of others make: by a name of theirs, or with a form of theirs."""

from __future__ import annotations

import socket

import pytest

TOKEN = "a-token-of-the-tests"
SAFE = {"GET", "HEAD", "OPTIONS"}


# DNS rebinding
@pytest.mark.parametrize(
    "host",
    ["evil.example", "evil.example:80", "127.0.0.1.evil.example", "localhost@evil.example", "", "[::2]", "0.0.0.0"],
)
def test_a_host_that_is_not_ours_is_refused(serve, host):
    served = serve()
    for path in ("/", "/api/session", "/static/omnilab.css"):
        answer = served.client.get(path, headers={"Host": host})
        assert answer.status_code == 400
        assert served.app.state.csrf not in answer.text


def test_hosts_that_are_ours_are_not(serve):
    served = serve(names=["Lab.example"])
    for host in ("127.0.0.1", "localhost:1", "[::1]:8700", "LOCALHOST", "lab.example:443"):
        assert served.client.get("/api/session", headers={"Host": host}).status_code == 200


def test_at_every_address_any_address_is_ours_and_no_name(serve):
    served = serve(host="0.0.0.0", token=TOKEN)
    for host, status in (("192.168.1.7:8700", 200), (socket.gethostname(), 200), ("evil.example", 400)):
        answer = served.client.get("/api/session", headers={"Host": host, "Authorization": f"Bearer {TOKEN}"})
        assert answer.status_code == status


# Forged requests
def test_every_change_needs_the_token_of_the_page(serve, routes):
    served = serve()
    changing = [(method, path) for method, path in routes if method not in SAFE and path != "/login"]
    changing.append(("POST", "/a/route/to/come"))
    for method, path in changing:
        for forged in ({}, {"X-CSRF-Token": ""}, {"X-CSRF-Token": "x"}, {"X-CSRF-Token": "é".encode("latin-1")}):
            answer = served.client.request(method, path, headers={"X-CSRF-Token": "", **forged})
            assert (answer.status_code, method, path) == (403, method, path)


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://127.0.0.1:1"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
        {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"},
    ],
)
def test_a_change_from_another_origin_is_refused_with_the_right_token_too(serve, headers):
    served = serve()
    for path in ("/api/submissions", "/login"):
        assert served.client.post(path, headers=headers).status_code == 403


def test_pages_of_others_read_nothing_and_show_nothing_but_may_link(serve):
    served = serve()
    for kind in ("empty", "image", "script", "iframe", "style"):
        mode = "navigate" if kind == "iframe" else "no-cors"
        headers = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": mode, "Sec-Fetch-Dest": kind}
        for path in ("/", "/api/session", "/events", "/static/omnilab.js"):
            assert served.client.get(path, headers=headers).status_code == 403
    link = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"}
    assert served.client.get("/", headers=link).status_code == 200


def test_no_origin_is_ever_told_that_it_may(serve, routes):
    served = serve()
    for method, path in [*routes, ("GET", "/static/omnilab.js")]:
        if path != "/events":
            headers = {"Origin": "http://evil.example", "Access-Control-Request-Method": "POST"}
            for asked in (method, "OPTIONS"):
                answer = served.client.request(asked, path, headers=headers)
                assert not [name for name in answer.headers if name.startswith("access-control")]
