"""The queue's pages in a browser, and its API."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from playwright.sync_api import Page, expect
from queue_for_tests import patched, until

from omnilab_serve.queue import children, run_queue

QUICK = "experiment=quick"


@pytest.fixture
def served(place: Any, serve: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> Any:
    """A service whose submissions run the program of these tests."""
    monkeypatch.setattr(children, "PROGRAM", children.PROGRAM)
    monkeypatch.setattr(run_queue, "check_request", run_queue.check_request)
    patched()
    found = serve(logs=place.logs)
    yield found
    for record in found.app.state.service.queue._records.values():
        if record.state == "running":
            children.tell_to_end(record.starts[-1].process, 3)


def submit(served: Any, *overrides: str, priority: int = 0) -> str:
    answer = served.client.post("/api/submissions", json={"overrides": [QUICK, *overrides], "priority": priority})
    assert answer.status_code == 201, answer.text
    return str(answer.json()["id"])


def state(served: Any, identity: str) -> str:
    return str(served.client.get(f"/api/submissions/{identity}").json()["state"])


def test_the_page_follows_the_queue_and_stops_what_runs(served: Any, place: Any, tab: Page) -> None:
    running = submit(served, f"wait={place.go}")
    submit(served, "seed=1")
    second = submit(served, "seed=2")
    tab.goto(f"{served.url}/queue")
    waiting = tab.locator("section, ol").filter(has=tab.locator(".place")).locator(".item")
    expect(waiting.nth(0)).to_contain_text("seed=1")
    waiting.nth(1).get_by_role("button", name="Sooner").click()
    expect(waiting.nth(0)).to_contain_text("seed=2")
    expect(tab.locator("#answer")).to_contain_text("Its priority is 1")
    waiting.nth(1).get_by_role("button", name="Take out").click()
    expect(waiting).to_have_count(1)
    tab.locator(f"#one-{running}").get_by_role("button", name="Stop").click()
    expect(tab.locator(f"#one-{running} .state.interrupted")).to_be_visible(timeout=30_000)
    expect(tab.locator(f"#one-{second} .state.done")).to_be_visible(timeout=30_000)
    tab.locator(f"#one-{running}").get_by_role("link", name="quick", exact=True).click()
    expect(tab.locator(".tail")).to_contain_text("it begins")
    expect(tab.locator(".copyable")).to_contain_text(f"omnilab experiment=quick wait={place.go}")
    place.go.touch()
    tab.get_by_role("button", name="Run again").click()
    expect(tab.locator("h1 + .state")).to_have_text("done", timeout=30_000)


def test_the_page_of_one_says_what_went_wrong_and_nothing_of_it_is_markup(served: Any, tab: Page) -> None:
    identity = submit(served, "ends=nothing", "word=<img src=x onerror=alert(1)>")
    until(lambda: state(served, identity) == "failed")
    tab.goto(f"{served.url}/queue/{identity}")
    expect(tab.locator(".notice.failed")).to_have_text("that cannot be")
    assert tab.locator("main img").count() == 0
    tab.set_viewport_size({"width": 420, "height": 800})
    tab.goto(f"{served.url}/queue")
    assert tab.evaluate("document.documentElement.scrollWidth") <= 420


def test_the_api_does_what_the_page_does(served: Any, place: Any) -> None:
    client, first = served.client, submit(served, f"wait={place.go}")
    until(lambda: state(served, first) == "running")
    second = submit(served, priority=3)
    assert [one["id"] for one in client.get("/api/submissions").json()] == [second, first]
    assert client.post(f"/api/submissions/{second}/priority", json={"priority": -1}).json()["priority"] == -1
    assert client.post(f"/api/submissions/{second}/cancel").json()["state"] == "cancelled"
    until(lambda: client.get(f"/api/submissions/{first}/output").json() == "it begins\n")
    path = client.get(f"/api/submissions/{first}").json()["path"]
    (place.logs / path).mkdir(parents=True)
    assert client.post("/api/submissions/interrupt", json={"path": path}).status_code == 204
    until(lambda: state(served, first) == "interrupted")
    assert client.post(f"/api/submissions/{second}/retry").json()["state"] == "queued"
    until(lambda: state(served, second) == "done")


@pytest.mark.parametrize("identity", ["nothing", "%2e%2e%2fhuey", "<b>", "0" * 12])
def test_an_id_that_is_none_is_not_there(identity: str, served: Any) -> None:
    for path in (f"/api/submissions/{identity}/output", f"/queue/{identity}", f"/parts/queue/{identity}"):
        answer = served.client.get(path)
        assert answer.status_code == 404
        assert "<b>" not in answer.text or answer.headers["content-type"] == "application/json"
    assert served.client.post(f"/queue/{identity}/cancel").status_code == 404


def test_changes_need_the_token_of_the_page(served: Any) -> None:
    identity = submit(served)
    del served.client.headers["X-CSRF-Token"]
    for path in (
        f"/queue/{identity}/cancel",
        f"/api/submissions/{identity}/retry",
        "/runs-stop/quick/x",
        "/sweeps-resume/x",
    ):
        assert served.client.post(path, headers={"Origin": "http://elsewhere.example"}).status_code == 403


def test_buttons_of_runs_and_sweeps_answer_in_a_sentence(served: Any, place: Any) -> None:
    client, folder = served.client, place.logs / "quick/sweep"
    assert client.post("/runs-stop/nothing").status_code == 404
    folder.mkdir(parents=True)
    answer = client.post("/sweeps-stop/quick/sweep", headers={"HX-Request": "true"})
    assert answer.status_code == 422
    assert "there is nothing to stop" in answer.text
    assert "no sweep that could go on" in client.post("/sweeps-resume/quick/sweep").text
    plan = {"command": ["-m", QUICK, "seed=1,2"], "directory": str(Path.cwd()), "experiment": "quick", "jobs": 2,
            "parameters": {"seed": ["1", "2"]}, "launcher": "basic", "sweeper": "basic", "omnilab": "0", "time": "",
            "format": 1}  # fmt: skip
    (folder / "sweep.yaml").write_text(yaml.safe_dump(plan))
    answer = client.post("/sweeps-resume/quick/sweep?retry_failed=true", headers={"HX-Request": "true"})
    assert "It is in the queue" in answer.text
    until(place.lines)
    assert place.lines()[0].endswith(f"sweep resume {folder} --retry-failed")
