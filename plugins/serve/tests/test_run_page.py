"""The page of a run, in a real browser: what it shows of runs of every state, live, and whoever wrote the folder."""

from __future__ import annotations

import csv
import json
import shutil
import signal
from datetime import UTC, datetime

import pytest


@pytest.fixture
def logs(tmp_path, finished_runs):
    """Logs with one finished run of its own, called grid/a."""
    run = next(file.parent for file in finished_runs.glob("quickstart/*/status.json"))
    shutil.copytree(run, tmp_path / "logs" / "grid" / "a")
    return tmp_path / "logs"


@pytest.fixture
def tab(tab):
    """Without the viewer, which has tests of its own, and without waiting for long."""
    tab.route("**/viewer/**", lambda route: route.abort())
    tab.set_default_timeout(60_000)
    return tab


@pytest.fixture
def running(logs, runs_on):
    """The process of the run, which goes on; its results are beside the logs."""
    run = logs / "grid" / "a"
    for name in ("metrics.csv", "queries.csv", "run.lock", "status.json"):
        (run / name).rename(logs.parent / name)
    return runs_on(run)


def note(run, done):
    """Write how far a run is."""
    now = datetime.now(UTC).isoformat()
    progress = {
        "stage": "queries",
        "done": done,
        "total": 200,
        "stage_left_s": 600.0,
        "finished": ["places"],
        "run_s": 9.0,
    }
    (run / "progress.json").write_text(json.dumps(progress | {"began": now, "written": now}))


def test_a_finished_run_shows_all_that_is_known_of_it(serve, tab, logs):
    run = logs / "grid" / "a"
    tab.goto(f"{serve(logs=logs).url}/runs/grid/a")
    assert tab.title() == "done · quickstart · omnilab"
    assert tab.locator("#run-head .state").inner_text() == "done"
    with (run / "metrics.csv").open(newline="") as file:
        metrics = list(csv.DictReader(file))
    assert tab.locator("#metrics tbody td:first-child").all_inner_texts() == [row["metric"] for row in metrics]
    assert float(tab.locator(".card b").first.inner_text()) == pytest.approx(float(metrics[0]["value"]), rel=1e-3)
    with (run / "queries.csv").open(newline="") as file:
        errors = sorted((float(row["error_m"]) for row in csv.DictReader(file)), reverse=True)
    shown = [float(text) for text in tab.locator("#worst tbody td:nth-child(2)").all_inner_texts()]
    assert shown == pytest.approx(errors[:10], rel=1e-3)
    assert "study.query_count=6" in tab.locator("#configuration li").all_inner_texts()
    tab.locator("#configuration summary").click()
    tab.locator("#configuration pre").wait_for()
    assert tab.locator("#configuration pre").inner_text().strip() == (run / "config.yaml").read_text().strip()
    assert f"omnilab repeat {run}" in tab.locator("#commands code").all_inner_texts()
    assert tab.locator("#run-files td:first-child").all_inner_texts() == sorted(file.name for file in run.iterdir())
    tab.locator("#figures img").first.scroll_into_view_if_needed()
    tab.wait_for_function("[...document.querySelectorAll('#figures img')].some(picture => picture.naturalWidth > 100)")
    assert tab.locator("#versions").inner_text().count("omnilab-") >= 5
    assert tab.locator("a", has_text="Compare with").get_attribute("href") == "/compare?run=grid/a"
    assert tab.locator("button", has_text="Stop").count() == 0


def test_a_live_run_moves_and_then_shows_its_results(serve, tab, logs, running):
    run = logs / "grid" / "a"
    note(run, 20)
    tab.goto(f"{serve(logs=logs).url}/runs/grid/a")
    assert "10 % (queries 20 of 200)" in tab.locator("#run-head").inner_text()
    assert "left" in tab.locator("#run-head .progress").inner_text()
    assert tab.locator("#metrics").count() == 0
    with (run / "run.log").open("a") as log:
        log.write("Traceback (most recent call last):\n  something\n2026-01-01 00:00:00,000 INFO omnilab: it went on\n")
    note(run, 86)
    tab.get_by_text("43 % (queries 86 of 200)").wait_for()
    tab.locator("#log summary").click()
    note(run, 100)
    tab.get_by_text("50 % (queries 100 of 200)").wait_for()
    assert tab.locator("#log details pre").is_visible()  # what was opened stays open
    for name in ("metrics.csv", "queries.csv", "status.json"):
        (logs.parent / name).replace(run / name)
    tab.locator("#run-head .state.done").wait_for()
    tab.locator("#metrics").wait_for()
    assert tab.locator("#worst tbody tr").count() == 6
    assert tab.title().startswith("done")


def test_the_stop_button_is_ctrl_c(serve, tab, logs, running):
    tab.on("dialog", lambda dialog: dialog.accept())
    tab.goto(f"{serve(logs=logs).url}/runs/grid/a")
    tab.locator("button", has_text="Stop").click()
    assert running.wait() == -signal.SIGINT
    tab.locator("#run-head .state.killed").wait_for()
    assert f"omnilab repair {logs / 'grid' / 'a'}" in tab.locator("#run-head code").all_inner_texts()
    tab.locator("#answer .notice").wait_for()


def test_a_failed_run_shows_its_error_first_and_the_traceback_folded(serve, tab, logs):
    run = logs / "grid" / "a"
    error = "DataError: <img src=x onerror=alert(1)> is no size; give one from 8 to 4096"
    (run / "status.json").write_text(json.dumps({"status": "failed", "pid": 1, "error": error}))
    (run / "metrics.csv").unlink()
    (run / "warnings.txt").write_text("<b>loud</b>\n")
    (run / "run.log").write_text(
        "2026-01-01 00:00:00,000 INFO omnilab: starts\n2026-01-01 00:00:01,000 ERROR omnilab: the run failed\n"
        "Traceback (most recent call last):\n  File 'x.py', line 1, in f\nIndexError: 3\n"
        "2026-01-01 00:00:02,000 INFO omnilab: failed in 2.0 s\n"
    )
    tab.goto(f"{serve(logs=logs).url}/runs/grid/a")
    notices = tab.locator("main .notice")
    assert notices.all_inner_texts() == [error, "<b>loud</b>"]
    assert tab.locator("img[src=x], main b:text('loud')").count() == 0
    end = tab.locator("#run-head details")
    assert "Traceback" in end.locator("summary").inner_text()
    assert not end.locator("pre").is_visible()
    end.locator("summary").click()
    assert "IndexError: 3" in end.locator("pre").inner_text()
    assert "omnilab repeat" not in tab.locator("main").inner_text()


DAMAGE = {
    "status.json": ["", "[]", '{"status": 3}', "\x00\xff"],
    "manifest.json": ["{", '{"experiment": "x", "overrides": [], "components": [1], "host": "me", "command": 7, "plugins_failed": {}}'],
    "metrics.csv": ["metric,value\n", "a\n", "metric,value,unit\nx,y,z\n"],
    "queries.csv": ["", '"', "error_m\nnan\ninf\nx\n\n", "query,error_m\n1\n2,3,4\n", "\x00\n\x00\n"],
    "config.yaml": ["a: [", "&a [*a]"],
    "run.log": ["\xff\x00\x1b[2J", "Traceback (most recent call last):"],
    "warnings.txt": ["\udcff"],
    "progress.json": ["{}"],
}  # fmt: skip


def test_a_damaged_run_shows_what_there_is(serve, logs):
    client, run = serve(logs=logs).client, logs / "grid" / "a"
    for name, content in [(name, content) for name, texts in DAMAGE.items() for content in texts]:
        before = (run / name).read_bytes() if (run / name).exists() else b""
        (run / name).write_bytes(content.encode("utf-8", "surrogateescape"))
        answer, settings = client.get("/runs/grid/a"), client.get("/parts/run-settings/grid/a")
        (run / name).write_bytes(before)
        assert (answer.status_code, settings.status_code) == (200, 200), (name, content)
        assert "/files/grid/a/run.rrd" in answer.text
        if name in {"status.json", "metrics.csv"} or content == "{":
            assert "omnilab repair" in answer.text, (name, content)


def test_a_run_in_a_folder_of_an_odd_name_has_its_page_and_files(serve, tab, logs):
    odd = "50 %? #1 & 'é' \"<i>.png"
    (logs / "grid" / "a").rename(logs / "grid" / odd)
    served = serve(logs=logs)
    tab.goto(served.url)
    tab.locator("tbody a").first.click()
    tab.locator("#run-files").wait_for()
    assert tab.locator(".trail span").inner_text() == f"grid/{odd}"
    href = tab.locator("#run-files a", has_text="config.yaml").get_attribute("href")
    assert served.client.get(href).text == (logs / "grid" / odd / "config.yaml").read_text()
    tab.locator("#configuration summary").click()
    tab.locator("#configuration pre").wait_for()


def test_a_job_leads_to_its_sweep(serve, tab, finished_runs):
    job = next(file.parent for file in finished_runs.glob("quickstart/*/0/status.json"))
    served = serve(logs=finished_runs)
    tab.goto(f"{served.url}/runs/{job.relative_to(finished_runs)}")
    sweep = job.parent.relative_to(finished_runs)
    assert tab.locator(".trail a").last.get_attribute("href") == f"/sweeps/{sweep}"


def test_what_is_no_run_has_no_page(serve, logs):
    client = serve(logs=logs).client
    for path in ("grid", "nothing", "grid/a/run.log", "", "grid/%2e%2e", "%2e%2e"):
        assert client.get(f"/runs/{path}").status_code == 404
        assert client.get(f"/viewer/{path}").status_code == 404
