"""`omnilab runs` and the link `latest`: data is shown as data, and a damaged run hides no other."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from omnilab.api import Metric, Report
from omnilab.errors import DataError
from omnilab.runner import terminal
from omnilab.runner.run_folder import DONE, RunFolder, find_runs, load_run
from omnilab.runner.sweeps import load_sweep
from omnilab.runner.sweeps.table import table
from omnilab.runner.terminal import print_error, print_table

WORLD = Path(__file__).parents[1] / "box_world.yaml"
MAP = [
    "experiment=map", f"sensor.world={WORLD}", "sensor.size=32", "sensor.samples=1", "study.step_m=1.5",
    "descriptor.offsets=32", "descriptor.angles=60", "~sinks.rerun", "~sinks.mcap",
]  # fmt: skip


def made(folder: Path, *overrides: str, status: str = DONE) -> Path:
    """A run that was never run: its folder."""
    run = RunFolder(folder)
    run.open({"experiment": "grid", "overrides": list(overrides)}, "study: {}\n")
    run.write(Report([Metric("nearest_rate", 0.75, "1")]))
    run.status(status)
    run.close()
    return folder


# ------------------------------------------------------------------------------------------------------- as data
@pytest.mark.parametrize(
    ("override", "shown"),
    [
        ("disturbance=[light,blur]", "disturbance=[light,blur]"),
        ("study.scenarios=[mine.yaml]", "study.scenarios=[mine.yaml]"),
        ("study.worlds=[/a/b.yaml]", "study.worlds=[/a/b.yaml]"),
        ("sensor.path=[bold]x[/bold]:warning:", "sensor.path=[bold]x[/bold]:warning:"),
        ("sensor.path=\x1b]0;title\x07\x1b[2J", r"sensor.path=\x1b]0;title\x07\x1b[2J"),
        ("sensor.path=a\nb\tc", r"sensor.path=a\nb\tc"),
        ("sensor.path=gpj.\u202eexe", r"sensor.path=gpj.\u202eexe"),
        ("sensor.path=été日本", "sensor.path=été日本"),
        ("seed=007", "seed=007"),
    ],
)
def test_overrides_are_shown_as_they_are(omnilab_here, tmp_path, override, shown):
    made(tmp_path / "logs" / "grid" / "a", override)
    result = omnilab_here("runs")
    assert result.rc == 0
    assert shown in result.stdout
    assert "\x1b" not in result.stdout


def test_names_of_folders_and_values_in_tables_are_data_too(omnilab_here, tmp_path, capsys):
    made(tmp_path / "logs" / "[red]" / "x\x1b[1m")
    listed = omnilab_here("runs").stdout
    assert r"[red]/x\x1b[1m" in listed
    print_table(["a[b]"], [["[/c]"], ["inf"], ["007"], ["1e3"], ["0.123456789"]], title="[/d]")
    assert [line.strip() for line in capsys.readouterr().out.splitlines() if "─" not in line] == [
        "[/d]", "a[b]", "[/c]", "inf", "007", "1000", "0.123457",
    ]  # fmt: skip


def test_a_long_table_is_the_same_as_rich_would_lay_it_out(monkeypatch, capsys):
    """Which takes ten seconds for ten thousand runs."""
    rows = [[f"é日本{i}", "1.234567891", "a\x1b[1m" if i % 3 else "[b]x"] for i in range(20)]
    print_table(["run", "日", "o[/]"], rows, title="[t]\n")
    monkeypatch.setattr(terminal, "LONG", 10)
    laid_out = capsys.readouterr().out
    print_table(["run", "日", "o[/]"], rows, title="[t]\n")
    assert capsys.readouterr().out == laid_out
    assert r"é日本19   1.23457   a\x1b[1m" in laid_out


def test_a_sentence_is_one_line_whatever_it_names(capsys):
    print_error("the file a\nb\x1b]0;t\x07\udcff[/x] is empty")
    assert capsys.readouterr().err == "omnilab: the file a\\nb\\x1b]0;t\\x07\\udcff[/x] is empty\n"


def test_a_warning_in_a_run_is_one_line_too(tmp_path, capsys):
    import logging

    run = RunFolder(tmp_path / "run")
    run.open({}, "")
    logging.getLogger("omnilab").warning("odd name %s", "\x1b[2J\n")
    run.close()
    assert capsys.readouterr().err == "omnilab: odd name \\x1b[2J\\n\n"


# ------------------------------------------------------------------------------------------------------- damage
def status(**changes: object) -> str:
    return json.dumps({"status": "running", "pid": 1, **changes})


HEADER = "metric,value,unit,low,high\n"
DAMAGES = [
    *[("status.json", status(pid=pid)) for pid in ("abc", None, [1], True, 1.5)],
    ("status.json", '{"status": "running", "pid": 1e400}'),
    ("status.json", status(status=None)),
    *[("status.json", text) for text in ("", "[]", "{", "[" * 10_000, '{"pid": ' + "9" * 5000 + "}", "\ufeff{}")],
    *[("manifest.json", json.dumps({"experiment": "grid", "overrides": o})) for o in (None, [1, 2], "a=1", {"a": 1})],
    ("manifest.json", '{"experiment": 3, "overrides": []}'),
    ("metrics.csv", "metric,value,unit\nnearest_rate\n"),
    ("metrics.csv", HEADER + "nearest_rate,0.7"),
    ("metrics.csv", HEADER + "nearest_rate,0.75,1,,"),
    ("metrics.csv", HEADER + "nearest_rate,,1,,\n"),
    ("metrics.csv", HEADER + "nearest_rate,0.75,1,,,,\n"),
    ("metrics.csv", HEADER + '"nearest_rate,0.75,1,,\n'),
    ("metrics.csv", HEADER + "x" * 200_000 + ",0.75,1,,\n"),
    ("metrics.csv", "name,value\nnearest_rate,1\n"),
    ("metrics.csv", ""),
]  # fmt: skip


@pytest.mark.parametrize(("file", "text"), DAMAGES, ids=range(len(DAMAGES)))
def test_any_damage_of_a_run_is_that_runs_row(omnilab_here, tmp_path, file, text):
    logs = tmp_path / "logs"
    made(logs / "grid" / "a"), made(logs / "grid" / "c")
    (made(logs / "grid" / "b") / file).write_text(text)
    result = omnilab_here("runs")
    assert (result.rc, result.stderr) == (0, "")
    first, damaged, last = result.stdout.splitlines()[2:]
    assert "nearest_rate 0.75" in first
    assert "nearest_rate 0.75" in last
    assert damaged.split()[:2] == ["grid/b", "unreadable"]
    assert f"{file} cannot be read (" in damaged
    assert not [word for word in ("char ", "Errno", "codec", "DictReader", "line 1 column") if word in damaged]
    header, rows = table(load_sweep(logs / "grid").jobs)
    assert [row[header.index("status")] for row in rows] == ["done", "unreadable", "done"]


@pytest.mark.parametrize("name", ["status.json", "manifest.json", "metrics.csv"])
@pytest.mark.parametrize("kind", ["fifo", "folder", "bytes"])
def test_what_is_no_file_of_text_is_that_runs_row_too(omnilab_here, tmp_path, name, kind):
    folder = made(tmp_path / "logs" / "grid" / "b")
    made(tmp_path / "logs" / "grid" / "c")
    file = folder / name
    file.unlink()
    {"fifo": lambda: os.mkfifo(file), "folder": file.mkdir, "bytes": lambda: file.write_bytes(b"\xff\xfe\0")}[kind]()
    listed = omnilab_here("runs").stdout.splitlines()[2:]
    assert [line.split()[1] for line in listed] == ["unreadable", "done"]
    assert "Errno" not in listed[0]
    if name == "status.json":
        for command in ("repeat", "repair", "view"):
            assert omnilab_here(command, str(folder)).rc == 2


def test_an_interval_that_is_no_number_is_named(tmp_path):
    folder = made(tmp_path / "run")
    (folder / "metrics.csv").write_text(HEADER + "nearest_rate,0.75,1,much,0\n")
    with pytest.raises(DataError, match=r"metrics.csv cannot be read \(low of nearest_rate is no number\)"):
        _ = load_run(folder).intervals


@pytest.mark.parametrize("pid", [0, -1, 2**31 - 1, 10**20])
def test_a_run_of_an_impossible_process_was_killed(tmp_path, pid):
    folder = made(tmp_path / "run")
    (folder / "status.json").write_text(status(pid=pid))
    assert load_run(folder).state == "killed"


# ------------------------------------------------------------------------------------------------------- latest
def test_a_file_called_latest_is_not_replaced(omnilab_here, tmp_path):
    (tmp_path / "latest").write_text("precious")
    result = omnilab_here(*MAP, "logs=.")
    assert result.rc == 2
    assert result.stderr.splitlines()[-1] == (
        "omnilab: latest is a file, and a link to the newest run belongs there; rename the file, or give another logs=DIR"
    )
    assert (tmp_path / "latest").read_text() == "precious"
    assert sorted(path.name for path in tmp_path.rglob("*") if path.is_file()) == ["latest"], "nothing was run"


def test_a_folder_called_latest_is_named_and_nothing_is_left_behind(tmp_path):
    (tmp_path / "latest").mkdir()
    with pytest.raises(DataError, match=r"latest is a folder, .*; rename the folder, or give another logs=DIR"):
        RunFolder(tmp_path / "grid" / "a").open({}, "", tmp_path / "latest")
    assert [path.name for path in tmp_path.iterdir()] == ["latest"]


@pytest.mark.parametrize("target", ["elsewhere", "."])
def test_a_link_called_latest_points_at_the_newest_run(tmp_path, target):
    (tmp_path / "latest").symlink_to(target)
    run = RunFolder(tmp_path / "grid" / "a")
    run.open({"experiment": "grid", "overrides": []}, "", tmp_path / "latest")
    run.close()
    assert (tmp_path / "latest").resolve() == tmp_path / "grid" / "a"


def test_runs_below_folders_called_latest_are_listed_once(omnilab_here, tmp_path):
    folder = made(tmp_path / "latest" / "logs" / "latest_grid" / "a")
    (tmp_path / "latest" / "logs" / "latest").symlink_to(folder)
    assert [run.folder for run in find_runs(tmp_path / "latest" / "logs")] == [folder]
    assert omnilab_here("runs", "latest/logs").stdout.count("nearest_rate") == 1


# ------------------------------------------------------------------------------------------------------- logs=
@pytest.mark.parametrize(("mode", "value"), [([], ""), (["-m"], ""), ([], "' '")], ids=["alone", "sweep", "blank"])
def test_logs_without_a_name_is_refused(omnilab_here, tmp_path, mode, value):
    result = omnilab_here(*mode, *MAP, f"logs={value}")
    assert (result.rc, result.stdout) == (2, "")
    (line,) = result.stderr.splitlines()
    assert "names no folder; give logs=DIR, or logs=. for the folder that you are in" in line
    assert not list(tmp_path.iterdir())
    assert not Path("/map").exists()


@pytest.mark.slow
def test_folders_of_any_depth_and_links_to_nowhere_hide_no_run(tmp_path, monkeypatch):
    logs = tmp_path / "logs"
    sound, torn = made(logs / "a"), made(logs / "b")
    (torn / "status.json").unlink()
    (torn / "status.json").symlink_to("status.json")
    monkeypatch.chdir(logs)
    for _ in range(1200):  # deeper than Python's stack
        os.mkdir("d")  # noqa: PTH102  no path is so long
        os.chdir("d")
    found = {run.folder: run for run in find_runs(logs)}
    assert found[sound].state == DONE
    with pytest.raises(DataError, match=r"status\.json cannot be read"):
        _ = found[torn].state
    for _ in range(1200):  # which no one else clears away
        os.chdir("..")
        os.rmdir("d")  # noqa: PTH106
