"""No route gives anything of outside the logs, whatever it is called by."""

from __future__ import annotations

import http.client
import json
import re
import shutil
from pathlib import Path
from urllib.parse import urlencode

import pytest
from fastapi.routing import APIRoute

from omnilab_serve.app import ROUTERS

SECRET = "A-SECRET-OF-ELSEWHERE"
ROUTES = [route for router in ROUTERS for route in router.routes if isinstance(route, APIRoute)]
WITH_PATH = [route for route in ROUTES if "{" in route.path]
PARAMETER = re.compile(r"{[^}]+}")
LINKED = "linked/2026-01-01_00-00-00-aaaaaa"


@pytest.fixture
def logs(tmp_path: Path, finished_runs: Path) -> Path:
    """Logs beside a run that is not in them, and links to it."""
    copy = tmp_path / "logs"
    shutil.copytree(finished_runs, copy, symlinks=True)
    run = next(copy.glob("quickstart/*/status.json")).parent
    outside = tmp_path / "outside" / "quickstart" / "2026-01-01_00-00-00-bbbbbb"
    shutil.copytree(run, outside)
    for file in outside.iterdir():
        if file.suffix in {".json", ".csv", ".yaml", ".log"}:
            text = file.read_text(encoding="utf-8")
            file.write_text(
                re.sub(r"quickstart|nearest_rate|descriptor", SECRET, text) + ("" if file.suffix != ".log" else SECRET)
            )
    (outside / "secret.txt").write_text(SECRET)
    (copy / "out").symlink_to(outside.parent)
    (copy / "loop").symlink_to(copy / "loop")
    (run / "leak.txt").symlink_to(outside / "secret.txt")
    (run / "leak").symlink_to(outside)
    linked = copy / LINKED
    linked.mkdir(parents=True)
    for file in outside.iterdir():
        (linked / file.name).symlink_to(file)
    sweep = next(copy.glob("quickstart/*/sweep.yaml")).parent
    twin = copy / "linked" / "sweep"
    shutil.copytree(sweep, twin)
    shutil.rmtree(twin / "0")
    (twin / "0").symlink_to(outside)
    return copy


def attacks(logs: Path) -> list[str]:
    """Paths that lead out of the logs, or nowhere, encoded as a browser never would."""
    inside = next(logs.glob("quickstart/*/status.json")).parent.relative_to(logs).as_posix()
    outside = "outside/quickstart/2026-01-01_00-00-00-bbbbbb"
    found = [f"../{outside}", f"{inside}/../../../{outside}", f"{logs.parent}/{outside}", f"/{logs.parent}/{outside}"]
    found += [path.replace("../", "..%2f") for path in found[:2]] + [path.replace("..", "%2e%2e") for path in found[:2]]
    found += [f"..\\{outside}", f"%c0%ae%c0%ae/{outside}", f"....//{outside}"]
    found += [f"out/{Path(outside).name}", "out", "loop", "loop/x", LINKED, "linked/sweep", "linked/sweep/0"]
    found += [f"{inside}/leak", f"{inside}/leak.txt", f"{inside}/leak/secret.txt", f"{inside}/leak/status.json"]
    found += [f"{path}/secret.txt" for path in found[:9]] + [f"{LINKED}/run.log", f"{LINKED}/config.yaml"]
    return [
        *found,
        "..",
        ".",
        "../..",
        "%00",
        f"{inside}%00.png",
        "%ff%fe",
        "x" * 3000,
        "%0d%0aX-Injected:%201",
        "linked",
    ]


def answer(served, method: str, target: str, body: object = None) -> tuple[int, str, list[tuple[str, str]]]:
    """Status, text and headers for a target that is sent as it is."""
    connection = http.client.HTTPConnection("127.0.0.1", served.settings.port, timeout=60)
    connection.putrequest(method, target, skip_host=True, skip_accept_encoding=True)
    text = b"" if body is None else json.dumps(body).encode()
    headers = {"Host": "localhost", "X-CSRF-Token": served.app.state.csrf, "Content-Length": str(len(text))}
    for name, value in (headers | {"Content-Type": "application/json"}).items():
        connection.putheader(name, value)
    connection.endheaders(text)
    with connection.getresponse() as found:
        result = found.status, found.read().decode("utf-8", "replace"), found.getheaders()
    connection.close()
    return result


def test_no_route_leads_out_of_the_logs(serve, logs):
    """Every route with a path, also one that is added later; whatever it changes is asked of nothing, too."""
    served = serve(logs=logs)
    assert len(WITH_PATH) > 10
    for route in WITH_PATH:
        for method in route.methods:
            for attack in attacks(logs):
                target = PARAMETER.split(route.path)[0] + attack + PARAMETER.split(route.path)[1]
                status, text, headers = answer(served, method, target)
                assert SECRET not in text, (method, target)
                refused = status == 307 or 400 <= status < 500  # 307: without the last /
                is_row = method == "GET" and target.startswith("/parts/")  # of what the logs themselves hold
                assert refused or is_row, (method, target, status, text[:300])
                assert not [name for name, _ in headers if name.lower() == "x-injected"]


def test_no_query_leads_out_of_the_logs(serve, logs):
    served = serve(logs=logs)
    for route in ROUTES:
        names = [parameter.alias for parameter in route.dependant.query_params]
        if "GET" in route.methods and "{" not in route.path:
            for attack in attacks(logs) if names else []:
                status, text, _ = answer(served, "GET", f"{route.path}?{urlencode(dict.fromkeys(names, attack))}")
                assert SECRET not in text, (route.path, attack)
                assert status < 500 or route.path == "/events", (route.path, attack, text[:300])


def test_no_body_leads_out_of_the_logs(serve, logs):
    served = serve(logs=logs)
    for path in ("/api/submissions/resume", "/api/submissions/interrupt"):
        for attack in attacks(logs):
            status, text, _ = answer(served, "POST", path, {"path": attack})
            assert SECRET not in text
            assert 400 <= status < 500, (path, attack, status, text[:300])


def test_lists_do_not_show_what_links_lead_to(serve, logs):
    served = serve(logs=logs)
    for path in ("/", "/sweeps", "/api/runs", "/api/sweeps"):
        text = served.client.get(path).text
        assert SECRET not in text
    runs = {run["path"]: run for run in served.client.get("/api/runs").json()["runs"]}
    assert runs[LINKED]["state"] == "unreadable"
    assert "link that leads out of the logs" in runs[LINKED]["error"]
