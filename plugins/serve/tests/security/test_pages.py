"""Every page in a real browser: nothing of a stranger's run is markup, and no other host is asked for anything."""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlencode

import pytest
import yaml
from fastapi.routing import APIRoute

from omnilab_serve import pages

ATTACK = """"'><img src=x onerror="window.attacked=1" data-attack><script>window.attacked=1</script>{{7*'7'}}"""
NAME = "<img src=x onerror=window.attacked=1 data-attack>"  # of a file or folder, which no / may stand in
NOT_PAGES = (
    "/events",
    "/login",
    "/files/",
    "/viewer-files/",
    "/viewer/",
    "/recording/",
    "/merged/",
    "/reports/",
    "/queue/{",
    "/parts/queue/{",
)
STOPPED = "https://"  # in what is said of requests of the viewer to its makers, which the policy of its page stops
FIND = "[...document.querySelectorAll('[data-attack]')].length + (window.attacked ? 1000 : 0)"


def addresses(runs: list[str], sweeps: list[str]) -> Iterator[str]:
    """Every page and part, also of those that are added later, for these runs and sweeps."""
    for router in pages.ROUTERS:
        for route in router.routes:
            assert isinstance(route, APIRoute)
            if "GET" in route.methods and not route.path.startswith(NOT_PAGES):
                kinds = sweeps if "sweep" in route.path else runs
                names = [parameter.alias for parameter in route.dependant.query_params]
                place = route.path.replace("{kind}/{name}", "descriptor/radon")
                if "{name}" in place:
                    continue  # a picture of a page
                yield from (place.replace("{path:path}", quote(path)) for path in (kinds if "{" in place else [""]))
                if "run" in names:
                    yield f"{route.path}?{urlencode({'run': runs[:2]}, doseq=True)}"


def settle(tab) -> None:
    """Wait until what the page fetches is there, and everything is unfolded."""
    tab.evaluate("document.querySelectorAll('details').forEach((part) => (part.open = true))")
    for _ in range(300):
        tab.wait_for_timeout(100)
        if tab.evaluate("document.readyState === 'complete' && !document.querySelector('.htmx-request')"):
            return
    pytest.fail("the page is not complete")


# ------------------------------------------------------------------------------------------------- no request elsewhere
@pytest.mark.slow
def test_every_page_is_complete_without_any_other_host(serve, tab, finished_runs):
    served = serve(logs=finished_runs)
    answered, failed = [], []
    tab.on("response", lambda answer: answered.append(answer.url))
    tab.on("response", lambda answer: answer.status >= 400 and failed.append((answer.status, answer.url)))
    tab.on(
        "console",
        lambda line: line.type == "error" and STOPPED not in line.text and failed.append(("console", line.text)),
    )
    runs = [run["path"] for run in served.client.get("/api/runs").json()["runs"]]
    sweeps = [sweep["path"] for sweep in served.client.get("/api/sweeps").json()]
    assert runs
    assert sweeps
    visited = [address for address in addresses(runs[:2], sweeps[:1]) if not address.startswith("/parts/")]
    for address in visited:
        tab.goto(served.url + address)
        settle(tab)
        assert failed == [], address
    assert len(visited) >= 8
    assert [url for url in answered if not url.startswith((served.url + "/", "data:", "blob:"))] == []


# ------------------------------------------------------------------------------------------------------ hostile folders
def spoilt(content: Any, keys: bool = False) -> Any:
    """The same with the attack at the end of every text, but for those that are read."""
    if isinstance(content, dict):
        return {(f"{key}{ATTACK}" if keys else key): spoilt(value, keys) for key, value in content.items()}
    if isinstance(content, list):
        return [spoilt(value, keys) for value in content]
    return content + ATTACK if isinstance(content, str) else content


def rewrite(file: Path, change: Callable[[Any], Any]) -> None:
    content = json.loads(file.read_text(encoding="utf-8"))
    file.write_text(json.dumps(change(content)), encoding="utf-8")


def spoil_table(file: Path, header: bool = False) -> None:
    rows = list(csv.reader(file.read_text(encoding="utf-8").splitlines()))
    known = {"metric", "value", "unit", "low", "high", "note", "query"}
    first = [name if name in known or not header else name + ATTACK for name in rows[0]]
    text = [[cell if _is_number(cell) or not cell else cell + ATTACK for cell in row] for row in rows[1:]]
    with file.open("w", encoding="utf-8", newline="") as stream:
        csv.writer(stream).writerows([first, *text])


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def spoil_run(run: Path) -> None:
    """Attacks in everything that a run's folder says, so that it is still read."""
    rewrite(run / "manifest.json", spoilt)
    rewrite(run / "progress.json", spoilt)
    spoil_table(run / "metrics.csv")
    spoil_table(run / "queries.csv", header=True)
    spoil_table(run / "cost.csv", header=True)
    config = yaml.safe_load((run / "config.yaml").read_text(encoding="utf-8"))
    (run / "config.yaml").write_text(yaml.safe_dump(spoilt(config) | {ATTACK: {ATTACK: ATTACK}}), encoding="utf-8")
    with (run / "run.log").open("a", encoding="utf-8") as log:
        log.write(f"2026-01-01 00:00:00,000 {ATTACK}\nTraceback (most recent call last):\n  {ATTACK}\n")
    for name in (f"{NAME}.txt", f"{NAME}.png", f"{NAME}.svg", f"{NAME}.html", f"recall{NAME}.png"):
        (run / name).write_text(f"<html>{ATTACK}</html>", encoding="utf-8")


@pytest.fixture
def hostile(tmp_path: Path, finished_runs: Path) -> Path:
    """Logs of a stranger."""
    logs = tmp_path / "logs"
    shutil.copytree(finished_runs, logs, symlinks=True)
    first, second, *_ = sorted(file.parent for file in logs.glob("quickstart/*/status.json"))
    spoil_run(first)
    first.rename(named := logs / "quickstart" / f"2026-01-01_00-00-00-aaaaaa{NAME}")
    shutil.copytree(named, failed := logs / NAME / "2026-01-01_00-00-00-bbbbbb")
    rewrite(failed / "status.json", lambda status: status | {"status": "failed", "error": f"ConfigError: {ATTACK}"})
    shutil.copytree(named, logs / NAME / "2026-01-01_00-00-00-cccccc")
    rewrite(logs / NAME / "2026-01-01_00-00-00-cccccc" / "status.json", lambda status: status | {"status": ATTACK})
    rewrite(second / "manifest.json", lambda manifest: manifest | {"overrides": ATTACK, "experiment": [ATTACK]})
    sweep = next(logs.glob("quickstart/*/sweep.yaml")).parent
    plan = yaml.safe_load((sweep / "sweep.yaml").read_text(encoding="utf-8"))
    (sweep / "sweep.yaml").write_text(yaml.safe_dump(spoilt(plan)), encoding="utf-8")
    lines = (sweep / "jobs.jsonl").read_text(encoding="utf-8").splitlines()
    events = [json.loads(line) for line in lines]
    for event in events:
        event.update({key: spoilt(value) for key, value in event.items() if key not in {"event", "state", "time"}})
    (sweep / "jobs.jsonl").write_text("".join(json.dumps(event) + "\n" for event in events), encoding="utf-8")
    for job in ("0", "1"):
        spoil_run(sweep / job)
    return logs


@pytest.mark.slow
def test_nothing_of_a_strangers_run_is_markup(serve, tab, hostile):
    served = serve(logs=hostile)
    refused = []
    tab.on(
        "console",
        lambda line: "Content Security Policy" in line.text and STOPPED not in line.text and refused.append(line.text),
    )
    records = served.client.get("/api/runs").json()["runs"]
    runs = [run["path"] for run in records]
    sweeps = [sweep["path"] for sweep in served.client.get("/api/sweeps").json()]
    assert len(runs) == 6
    assert sum(any(ATTACK in name for name in run["metrics"]) for run in records) >= 4  # they are read
    shown = 0
    for address in [*addresses(runs, sweeps), f"/?q={quote(ATTACK)}", f"/runs/{quote(ATTACK)}", f"/{quote(ATTACK)}"]:
        tab.goto(served.url + address)
        settle(tab)
        assert (tab.evaluate(FIND), address) == (0, address)
        assert refused == [], address  # nor was there anything that the policy had to stop
        shown += "onerror" in tab.inner_text("body")
    assert shown > 5


@pytest.mark.slow
def test_files_of_a_stranger_are_never_pages(serve, tab, hostile):
    """Opened on their own, by a link of a stranger: text, a picture, or something to be saved."""
    served = serve(logs=hostile)
    for run in served.client.get("/api/runs").json()["runs"]:
        found = served.client.get(f"/api/files/{quote(run['path'])}").json()
        for file in found if isinstance(found, list) else []:
            answer = served.client.get(f"/files/{quote(run['path'])}/{quote(file['name'])}")
            kind = answer.headers["content-type"].split(";")[0]
            assert kind in {"image/png", "text/plain", "application/octet-stream", "application/json"}, file
            assert answer.headers["x-content-type-options"] == "nosniff"
            if kind == "application/octet-stream":
                assert answer.headers["content-disposition"].startswith("attachment")
            if kind == "image/png":
                assert answer.content.startswith(b"\x89PNG")
    (first, *_) = served.client.get("/api/runs?q=state:failed").json()["runs"]
    report = served.client.get(f"/api/reports/{quote(first['path'])}", timeout=120)
    assert report.headers["content-disposition"].startswith("attachment")
    assert "onerror" in report.text
    assert not [attack for attack in (ATTACK, NAME) if attack in report.text]
