"""The table of runs and that of sweeps, in a browser."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import pytest
from playwright.sync_api import expect


@pytest.fixture
def served(serve, finished_runs, tmp_path):
    shutil.copytree(finished_runs, tmp_path / "logs", symlinks=True)
    return serve()


def test_the_table_shows_runs_and_a_new_one_by_itself(served, tab, tmp_path):
    tab.goto(served.url)
    rows = tab.locator("tbody tr")
    expect(rows).to_have_count(4)
    first = rows.first
    expect(first).to_contain_text("done")
    expect(first).to_contain_text("nearest_rate")
    expect(first).to_contain_text("seed=4")
    expect(first).not_to_contain_text("logs=")
    expect(tab.locator("#run-count")).to_have_text("4 runs")
    copied = next((tmp_path / "logs/quickstart").glob("*/status.json")).parent
    shutil.copytree(copied, tmp_path / "logs/quickstart/another")
    expect(rows).to_have_count(5)
    expect(tab.locator("#run-count")).to_have_text("5 runs")


def test_filter_order_and_columns_are_in_the_address(served, tab):
    tab.goto(served.url)
    rows = tab.locator("tbody tr")
    tab.keyboard.press("/")
    tab.keyboard.type("descriptor:radon seed>=3")
    expect(rows).to_have_count(2)
    expect(tab.locator("#run-count")).to_have_text("2 of 4 runs")
    tab.click("#columns summary")
    tab.get_by_label("nearest_rate", exact=True).check()
    tab.get_by_label("Host").uncheck()
    expect(tab.get_by_role("columnheader", name="nearest_rate")).to_be_visible()
    expect(tab.get_by_role("columnheader", name="Host")).to_have_count(0)
    tab.keyboard.press("Escape")
    tab.get_by_role("link", name="nearest_rate").click()
    expect(tab.locator("th[aria-sort=ascending]")).to_have_text("nearest_rate")
    address = parse_qs(urlsplit(tab.url).query)
    assert address["q"] == ["descriptor:radon seed>=3"]
    assert address["sort"] == ["nearest_rate"]
    assert address["column"] == ["overrides", "main", "started", "seconds", "nearest_rate"]
    shown = rows.all_inner_texts()
    tab.goto(tab.url)
    assert rows.all_inner_texts() == shown
    tab.goto(served.url)  # the columns are remembered
    expect(tab.get_by_role("columnheader", name="nearest_rate")).to_be_visible()
    expect(rows).to_have_count(4)


def test_a_filter_that_cannot_be_read_is_said_at_the_field(served, tab):
    tab.goto(served.url)
    tab.fill("#q", "step_m>wide")
    expect(tab.locator("#why")).to_have_text(
        "the filter step_m>wide needs a number behind >, not wide; for a text write step_m:wide"
    )
    expect(tab.locator("tbody tr")).to_have_count(4)
    tab.fill("#q", "stepm>0.2")
    expect(tab.locator("#why")).to_be_hidden()
    expect(tab.locator("tbody")).to_contain_text(["called stepm; is it step_m?", ""])


def test_ticks_outlive_filters_and_lead_to_the_comparison(served, tab):
    tab.goto(served.url)
    boxes = tab.locator("[data-tick]")
    paths = [boxes.nth(i).get_attribute("data-tick") for i in (0, 3)]
    boxes.nth(0).check()
    expect(tab.locator("#ticked a")).to_be_hidden()
    boxes.nth(3).check()
    tab.fill("#q", "no such run")
    expect(boxes).to_have_count(0)
    tab.fill("#q", "")
    expect(boxes).to_have_count(4)
    expect(boxes.nth(3)).to_be_checked()
    link = tab.get_by_role("link", name="Compare", exact=True).last
    assert parse_qs(urlsplit(link.get_attribute("href")).query) == {"run": paths}
    tab.get_by_role("button", name="Clear").click()
    expect(boxes.nth(3)).not_to_be_checked()


def test_many_runs_come_as_they_are_scrolled_to(serve, tab, tmp_path):
    for i in range(230):
        folder = tmp_path / f"logs/many/{i:03}"
        folder.mkdir(parents=True)
        (folder / "manifest.json").write_text(json.dumps({"experiment": "grid", "overrides": [f"seed={i}"]}))
        (folder / "status.json").write_text('{"status": "done", "pid": 1, "time": "2026-11-29T12:00:00+00:00"}')
    tab.goto(f"{serve().url}/?sort=path")
    rows = tab.locator("tbody tr:has([data-tick])")
    expect(rows).to_have_count(100)
    tab.locator("tbody").last.scroll_into_view_if_needed()
    expect(rows).to_have_count(200)
    tab.locator("tbody").last.scroll_into_view_if_needed()
    expect(rows).to_have_count(230)
    shutil.rmtree(tmp_path / "logs/many/229")
    expect(rows).to_have_count(229)
    shutil.rmtree(tmp_path / "logs/many/000")  # far above what is shown
    tab.evaluate("scrollTo(0, 0)")
    expect(rows.first).to_contain_text("many/001")


def test_what_a_run_says_is_text(serve, tab, tmp_path):
    folder: Path = tmp_path / "logs/odd <b>&'\"/x"
    folder.mkdir(parents=True)
    text = "<script>document.title='taken'</script>\ud800"
    manifest = {"experiment": text, "overrides": [text], "host": {"name": text}, "components": {text: {"name": text}}}
    (folder / "manifest.json").write_text(json.dumps(manifest))
    (folder / "status.json").write_text(json.dumps({"status": text, "pid": 1, "time": text, "error": text}))
    (folder / "metrics.csv").write_text(f"metric,value,unit\n{text[:-1]},1,{text[:-1]}\n")
    (folder / "config.yaml").write_text('study: {a: "\\ud800"}\n')
    served = serve()
    tab.goto(served.url)
    expect(tab.locator("tbody tr")).to_contain_text(text[:-1])
    tab.click("#columns summary")
    expect(tab.locator(".choices")).to_contain_text(text[:-1])
    assert served.client.get("/api/runs").json()["runs"][0]["overrides"] == [text[:-1] + "?"]
    assert tab.title() == "Runs · omnilab"


def test_the_sweeps(served, tab):
    tab.goto(f"{served.url}/sweeps")
    row = tab.locator("tbody tr")
    expect(row).to_have_count(1)
    expect(row).to_contain_text("2 done")
    expect(row).to_contain_text("seed=3,4")
    path = row.get_by_role("link").get_attribute("href").removeprefix("/sweeps/")
    with (Path(served.settings.logs) / path / "jobs.jsonl").open("a") as out:
        out.write('{"event": "failed", "job": 1, "error": "as if"}\n')
    expect(row).to_contain_text("1 done, 1 failed")


def test_runs_and_sweeps_as_data(served):
    found = served.client.get("/api/runs", params={"q": "descriptor:hog", "sort": "seed"}).json()
    assert found["total"] == 1
    (run,) = found["runs"]
    assert run["components"]["descriptor"] == "hog"
    assert run["settings"]["study.step_m"] == 1.0
    assert served.client.get(f"/api/runs/{run['path']}").json() == run
    assert served.client.get("/api/runs", params={"limit": 1, "offset": 3}).json()["total"] == 4
    assert [sweep["counts"] for sweep in served.client.get("/api/sweeps").json()] == [{"done": 2}]
    assert served.client.get("/api/runs/not/there").status_code == 404
    answer = served.client.get("/api/runs", params={"q": "step_m>"})
    assert (answer.status_code, answer.json()["detail"][:18]) == (422, "the filter step_m>")
