"""Who comes in."""

from __future__ import annotations

import inspect

from omnilab_serve.security import access, gate

TOKEN = "a-token-of-the-tests"


def test_nothing_is_answered_without_the_token(serve, routes):
    served = serve(token=TOKEN)
    for method, path in [*routes, ("GET", "/a/route/to/come"), ("GET", "/api/openapi.json")]:
        if path != "/login":
            answer = served.client.request(method, path)
            assert (answer.status_code, method, path) == (401, method, path)
            assert served.app.state.csrf not in answer.text


def test_a_wrong_token_is_refused(serve):
    served = serve(token=TOKEN)
    wrong = ["", "Bearer", f"Bearer {TOKEN[:-1]}", f"Bearer {TOKEN}x", f"Basic {TOKEN}", TOKEN]
    for given in wrong:
        assert served.client.get("/api/session", headers={"Authorization": given}).status_code == 401
    assert (
        served.client.get("/api/session", headers={"Cookie": f"omnilab_{served.settings.port}={TOKEN}"}).status_code
        == 401
    )
    right = {"Authorization": f"Bearer {TOKEN}"}
    assert served.client.get("/api/session", headers=right).status_code == 200


def test_the_token_is_enough_for_a_change(serve):
    served = serve(token=TOKEN)
    headers = {"Authorization": f"Bearer {TOKEN}", "X-CSRF-Token": ""}
    assert served.client.post("/api/submissions", headers=headers, json={}).status_code not in {401, 403}


def test_guesses_are_slowed(serve):
    served = serve(token=TOKEN)
    for _ in range(access.MOST_WRONG):
        assert served.client.get("/api/session", headers={"Authorization": "Bearer guess"}).status_code == 401
    right = {"Authorization": f"Bearer {TOKEN}"}
    assert served.client.get("/api/session", headers=right).status_code == 429
    assert served.client.post("/login", data={"token": TOKEN}).status_code == 429


def test_the_login_page_gives_a_cookie_that_scripts_and_other_sites_do_not_have(serve):
    served = serve(token=TOKEN)
    assert served.client.get("/").status_code == 401
    assert "set-cookie" not in served.client.post("/login", data={"token": "wrong"}).headers
    answer = served.client.get("/login", params={"token": TOKEN})
    cookie = answer.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "samesite=strict" in cookie.lower()
    assert TOKEN not in cookie
    assert served.client.get("/").status_code == 200
    assert served.client.post("/api/submissions", headers={"X-CSRF-Token": ""}).status_code == 403


def test_a_browser_logs_in_by_the_form(serve, tab):
    served = serve(token=TOKEN)
    tab.goto(served.url)
    tab.fill("#token", "wrong")
    tab.click("button[type=submit]")
    tab.wait_for_selector("[role=alert]")
    tab.fill("#token", TOKEN)
    tab.click("button[type=submit]")
    tab.wait_for_selector("h1:has-text('Runs')")


def test_secrets_are_compared_in_constant_time():
    """By construction: no `==` stands in the modules that compare them, hmac.compare_digest does."""
    compared = [access.Access.by_cookie, access.Access.try_token, gate.RequestGate._by_csrf]
    for function in compared:
        source = inspect.getsource(function)
        assert "hmac.compare_digest(" in source
        assert "==" not in source
    assert inspect.getsource(access).count("compare_digest") + inspect.getsource(gate).count("compare_digest") == 3
