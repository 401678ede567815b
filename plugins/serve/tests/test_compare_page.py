"""The page of a comparison: the numbers of the command, in a real browser."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from rerun.chunk import RrdReader

from omnilab.errors import DataError
from omnilab_serve import commands
from omnilab_serve.commands import run_command
from omnilab_serve.comparing import Comparisons


@pytest.fixture(scope="session")
def compared(finished_runs):
    """The two runs, and the sweep: their paths, and what the command says of them."""
    found = sorted(path.parent for path in finished_runs.glob("quickstart/*/status.json"))
    (sweep,) = {path.parent.parent for path in finished_runs.glob("quickstart/*/*/status.json")}
    call = [sys.executable, "-m", "omnilab", "compare", *map(str, [*found, sweep])]
    wide = {**os.environ, "COLUMNS": "400"}
    shown = subprocess.run(call, capture_output=True, text=True, check=True, env=wide).stdout
    data = subprocess.run([*call, "--json"], capture_output=True, text=True, check=True).stdout
    return [path.relative_to(finished_runs).as_posix() for path in [*found, sweep]], shown, json.loads(data)


def test_a_browser_shows_the_numbers_of_the_command(serve, tab, finished_runs, compared):
    paths, shown, document = compared
    served = serve(logs=finished_runs)
    tab.goto(f"{served.url}/compare?" + "&".join(f"run={path}" for path in paths))
    tab.locator("#metrics").wait_for(timeout=60_000)
    assert len(document["configurations"]) == 2
    for metric in document["metrics"]:
        row = tab.locator("#metrics tbody tr").filter(has=tab.locator("th", has_text=metric["name"])).first
        texts = [c["metrics"][metric["name"]]["text"] for c in document["configurations"]]
        assert row.locator("td").all_inner_texts() == texts
        assert all(text in shown for text in texts)
    assert tab.locator(".chart svg[role=img]").count() >= 3
    best = tab.locator("#metrics td.best")
    assert best.count() >= 1
    metric = tab.locator("#metrics tbody tr", has_text="nearest_rate")
    metric.locator("a", has_text="▴").click()
    tab.locator("#metrics tr", has_text="nearest_rate").locator("td.best").wait_for(timeout=60_000)
    tab.get_by_label("Metric").select_option("recall_at_1")
    tab.locator("figcaption", has_text="recall_at_1 over descriptor").wait_for(timeout=20_000)


def test_runs_are_chosen_by_ticks(serve, tab, finished_runs, compared):
    served = serve(logs=finished_runs)
    first, second = compared[0][:2]
    tab.goto(f"{served.url}/compare?run={first}")
    assert tab.get_by_label(first, exact=True).is_checked(), "one run alone is compared with nothing"
    tab.get_by_label(second, exact=True).check()
    tab.get_by_role("button", name="Compare").click()
    tab.locator("#metrics").wait_for(timeout=60_000)
    assert tab.locator("thead .key").all_inner_texts()[:2] == ["A", "B"]


@pytest.mark.parametrize("path", ["..", "/etc", "none", "quickstart/../../x", "a\0b", "<script>alert(1)</script>"])
def test_only_what_is_in_the_logs_is_compared(serve, finished_runs, path):
    served = serve(logs=finished_runs)
    for address in ("/compare", "/parts/compare", "/parts/merged"):
        answer = served.client.get(address, params={"run": path})
        assert answer.status_code == 404
        assert "<script>alert" not in answer.text


def test_recordings_become_one_that_the_viewer_shows(serve, finished_runs, compared, tmp_path):
    served = serve(logs=finished_runs)
    runs = [("run", path) for path in compared[0][:2]]
    part = served.client.get("/parts/merged", params=runs, timeout=120)
    assert part.status_code == 200
    (address,) = re.findall(r'<iframe class="recording" src="(/merged/[0-9a-f]{32})"', part.text)
    assert f'data-recording="{address}/runs.rrd"' in served.client.get(address).text
    file = tmp_path / "runs.rrd"
    file.write_bytes(served.client.get(f"{address}/runs.rrd").content)
    curves = {chunk.entity_path for chunk in RrdReader(file).stream() if chunk.entity_path.endswith("error/position_m")}
    assert len(curves) == 2, "one of each run"
    for key in ("0" * 32, "..", "x", address.removeprefix("/merged/").upper()):
        assert served.client.get(f"/merged/{key}/runs.rrd").status_code in (404, 422)


def test_what_cannot_be_compared_is_said_in_the_command_s_words(serve, tmp_path):
    served = serve()
    (tmp_path / "logs" / "empty").mkdir()
    answer = served.client.get("/parts/compare", params={"run": "empty"}, headers={"HX-Request": "true"})
    assert answer.status_code == 422
    assert "empty holds no run, and no sweep" in answer.text


def test_a_comparison_is_computed_once_until_a_run_changes(finished_runs, compared, monkeypatch):
    calls = []

    def counted(words):
        calls.append(words)
        return run_command(words)

    monkeypatch.setattr("omnilab_serve.comparing.documents.run_command", counted)
    comparisons, folder = Comparisons(finished_runs), finished_runs / compared[0][0]
    first = comparisons.document([folder])
    assert comparisons.document([folder]) is first
    assert len(calls) == 1
    assert [run["path"] for run in first["runs"]] == compared[0][:1]
    (folder / "status.json").touch()
    assert comparisons.document([folder]) == first
    assert len(calls) == 2


def test_a_command_that_fails_hangs_or_says_too_much_is_an_error(monkeypatch, tmp_path):
    with pytest.raises(DataError, match=r"none holds no run"):
        run_command(["compare", str(tmp_path / "none")])
    program = Path(tmp_path / "program.py")
    monkeypatch.setattr(commands, "PROGRAM", (sys.executable, str(program)))
    program.write_text("import time, subprocess; subprocess.Popen(['sleep', '600']); time.sleep(600)")
    with pytest.raises(DataError, match=r"omnilab x took more than 1 s and was ended; run it in a terminal"):
        run_command(["x"], limit_s=1.0)
    monkeypatch.setattr(commands, "LARGEST", 1000)
    program.write_text("print('x' * 2000)")
    with pytest.raises(DataError, match=r"omnilab x printed more than 0 MiB"):
        run_command(["x"])
    program.write_text("raise SystemExit(3)")
    with pytest.raises(DataError, match=r"omnilab x ended with code 3; run it in a terminal"):
        run_command(["x"])
