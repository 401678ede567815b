"""`omnilab fidelity` on made-up run folders: what it uses, what it refuses, what it writes, what it runs."""

import os
import re
import shutil
import signal
import sys
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from omnilab.api import Metric, Report
from omnilab.runner.config import resolved_yaml
from omnilab.runner.fidelity import command
from omnilab.runner.fidelity.claims import read_claims
from omnilab.runner.fidelity.kept import read_kept, write_kept
from omnilab.runner.fidelity.measured import RunSettings
from omnilab.runner.overrides.composition import check_build, compose_job
from omnilab.runner.registry import discover
from omnilab.runner.run_folder import DONE, FAILED, RunFolder

CLAIMS = """\
title: Chapter one
source: A paper
runs:
  graph: {recipe: pose_graph, minutes: 2}
  wrong: {recipe: pose_graph, overrides: [study.wrong_loops=0.2], minutes: 1}
claims:
  - {id: small, place: "1", says: It is small., reported: "0.1 m", expect: {at_most: 0.1},
     protocol: {run: graph, metric: ate}, variant: {run: wrong, metric: ate}, note: in a | room}
  - {id: order, place: "2", says: It grows., reported: a < b, expect: {order: rising},
     protocol: {metrics: {a: {run: graph, metric: ate}, b: {run: wrong, metric: ate}}}}
  - {id: cell, place: "3", says: Half., reported: "0.5", expect: {about: 0.5, within: 0.01},
     protocol: {run: graph, metric: "times.csv[method=b].ms / times.csv[method=a].ms"}}
  - {id: mean, place: "4", says: Most., reported: "4", expect: {at_most: 3},
     protocol: {run: graph, metric: "max(times.csv.ms)"}}
  - {id: within, place: "6", says: With an interval., reported: "3", expect: {at_most: 3},
     protocol: {run: graph, metric: "times.csv[method=b].step_ms"}}
  - {id: never, place: "5", says: Never., reported: "1", not_reproduced: nobody can}
"""


@pytest.fixture(scope="module")
def configurations():
    """config.yaml of the recipe, and of the recipe with overrides."""
    registry = discover("")
    words = {"graph": ["experiment=pose_graph"], "wrong": ["experiment=pose_graph", "study.wrong_loops=0.2"]}
    words["other"] = ["experiment=pose_graph", "study.wrong_loops=0.3"]
    return {name: resolved_yaml(check_build(compose_job(each, registry)[0], registry)) for name, each in words.items()}


@pytest.fixture
def made(tmp_path, configurations):
    """`made("graph", seed=1, ate=0.2)`: a run folder in tmp_path/logs."""

    def make(name, ate, seed=0, status=DONE, interval=None, times=((2.0, 4.0), ("b", "a"))):
        folder = tmp_path / f"logs/pose_graph/{name}-{seed}-{ate}"
        run = RunFolder(folder)
        study = {"name": "pose_graph", "class": "a.b", "distribution": "omnilab-studies", "version": "9.8.7"}
        backend = {"name": "gtsam_batch", "class": "a.c", "distribution": "omnilab-slam", "version": "9.8.7"}
        components = {"study": study, "backend": backend, "sinks.rerun": {"name": "rerun"}}
        manifest = {"experiment": "pose_graph", "overrides": [], "components": components, "commit": "abcdef0123"}
        run.open(manifest, configurations[name].replace("\nseed: 0\n", f"\nseed: {seed}\n"))
        metrics = [] if ate is None else [Metric("ate", ate, "m", interval)]
        table = {"ms": list(times[0]), "method": list(times[1]), "ms_low": [1.5, np.nan][: len(times[0])]}
        table["ms_high"] = [2.5, np.nan][: len(times[0])]
        table |= {column.replace("ms", "step_ms", 1): values for column, values in table.items() if "ms" in column}
        run.write(Report(metrics, tables={"times": table}))
        run.end(status)
        return folder

    return make


@pytest.fixture
def fidelity(tmp_path, monkeypatch, omnilab_here):
    """`fidelity("report", "logs")`: the command, with the claims above."""
    file = tmp_path / "one.yaml"
    file.write_text(CLAIMS)
    monkeypatch.setattr(command, "shipped_claims", lambda: read_claims([file]))
    return lambda *arguments: omnilab_here("fidelity", *arguments)


def rows_of(text):
    return {
        line.split("`")[1]: [cell.strip() for cell in line.split(" | ")] for line in text.splitlines() if "| `" in line
    }


def test_the_table_is_of_the_run_folders(fidelity, made, tmp_path):
    for seed, ate in enumerate((0.2, 0.3, 0.1)):
        made("graph", ate, seed)
    made("wrong", 0.05, interval=(0.04, 0.06))
    made("other", 0.01)
    made("graph", 0.0, seed=7, status=FAILED)
    assert fidelity("report", "logs", "-o", "docs/table.md").rc == 0
    text = (tmp_path / "docs/table.md").read_text()
    rows = rows_of(text)
    assert rows["small"][1:6] == [
        "0.1 m", "at most 0.1", "`ate` 0.2 [-0.0484, 0.448] m (3 seeds)", "`ate` 0.05 [0.04, 0.06] m (one run)",
        "**reached by the variant**",
    ]  # fmt: skip
    assert rows["order"][3] == "a 0.2 [-0.0484, 0.448] m (3 seeds); b 0.05 [0.04, 0.06] m (one run)"
    assert rows["order"][5] == "**other order** ~"
    assert rows["cell"][5] == "**reached**"
    assert rows["mean"][3] == "`max(times.csv.ms)` 4 [4, 4] ms (3 seeds)"
    assert rows["mean"][5] == "**not reached**"
    assert rows["never"][5] == "**cannot be tested**"
    assert rows["within"][5] == "**reached** †"
    assert "\n† About times, which are those of the machine" in text
    assert "| Chapter one | 6 | 2 | 1 | 1 | 1 | – | 1 |" in text
    assert "- `small`: in a | room" in text
    assert "| graph | `omnilab experiment=pose_graph` | 0, 1, 2 | `pose_graph/graph-0-0.2`" in text
    assert "9.8.7 `abcdef0`" in text
    assert "1 runs in the folders are of no claim" in text
    assert "not used: graph-7-0.0 (failed" in text


def test_what_was_not_run_is_not_measured_and_a_run_of_a_seed_counts_once(fidelity, made, tmp_path):
    made("graph", 0.3)
    made("graph", 0.4)  # its folder's name is later
    assert fidelity("report", "logs").rc == 0
    rows = rows_of((tmp_path / "fidelity.md").read_text())
    assert rows["small"][3:6] == ["`ate` 0.4 m (one run)", "not measured", "**not reached**"]
    assert rows["order"][5] == "**not measured**"
    assert rows["within"][3:6] == ["`times.csv[method=b].step_ms` 2 [1.5, 2.5] ms (one run)", "–", "**reached** †"]


def test_a_run_of_before_a_setting_counts_and_one_of_other_components_does_not(fidelity, made, tmp_path):
    old = made("graph", 0.3)
    text = (old / "config.yaml").read_text()
    assert "\n  show: 30\n" in text  # of the study, at its default
    (old / "config.yaml").write_text("".join(line for line in text.splitlines(True) if "  show:" not in line))
    other = made("wrong", 0.2)
    (other / "manifest.json").write_text((other / "manifest.json").read_text().replace("gtsam_batch", "gtsam_gnc"))
    assert fidelity("report", "logs").rc == 0
    text = (tmp_path / "fidelity.md").read_text()
    assert rows_of(text)["small"][3:5] == ["`ate` 0.3 m (one run)", "not measured"]
    assert "1 runs in the folders are of no claim" in text


def test_a_damaged_run_and_a_metric_that_is_not_there_are_told(fidelity, made, tmp_path):
    (made("graph", 0.3) / "metrics.csv").write_text("metric,value,unit\nate,0.")
    made("wrong", None, times=((1.0,), ("a",)))
    assert fidelity("report", "logs").rc == 0
    text = (tmp_path / "fidelity.md").read_text()
    assert rows_of(text)["small"][5] == "**not measured**"
    assert "metrics.csv cannot be read" in text
    assert "has no metric ate; run it again" in text


def test_measurements_outlive_their_folders(fidelity, made, tmp_path):
    made("graph", 0.3)
    made("wrong", 0.2, interval=(0.1, 0.3))
    assert fidelity("report", "logs", "--keep", "kept.json", "-o", "first.md").rc == 0
    shutil.rmtree(tmp_path / "logs")
    kept = (tmp_path / "kept.json").read_bytes()
    assert fidelity("report", "--keep", "kept.json", "-o", "second.md").rc == 0
    first, second = ((tmp_path / name).read_text() for name in ("first.md", "second.md"))
    assert second == first.replace("`pose_graph/graph-0-0.3`", "`pose_graph/graph-0-0.3` (kept)").replace(
        "`pose_graph/wrong-0-0.2`", "`pose_graph/wrong-0-0.2` (kept)"
    )
    assert (tmp_path / "kept.json").read_bytes() == kept
    made("graph", 0.05)
    made("graph", 0.06, seed=1)
    assert fidelity("report", "logs", "--keep", "kept.json", "--claims", "small").rc == 0
    small = rows_of((tmp_path / "fidelity.md").read_text())["small"]
    assert small[3:5] == ["`ate` 0.055 [-0.00853, 0.119] m (2 seeds)", "`ate` 0.2 [0.1, 0.3] m (one run)"]
    assert fidelity("report", "--keep", "kept.json").rc == 0
    assert "**not measured**" not in (tmp_path / "fidelity.md").read_text()


def test_a_newer_measurement_counts_though_its_folder_is_gone(fidelity, made, tmp_path):
    folder = made("graph", 0.3)
    assert fidelity("report", "logs", "--keep", "kept.json").rc == 0
    status = folder / "status.json"
    status.write_text(re.sub(r'"time": "\d+', '"time": "1999', status.read_text()))
    (folder / "metrics.csv").write_text("metric,value,unit\nate,0.5,m\n")
    assert fidelity("report", "logs", "--keep", "kept.json").rc == 0
    assert rows_of((tmp_path / "fidelity.md").read_text())["small"][3] == "`ate` 0.3 m (one run)"


def test_what_was_kept_of_another_configuration_is_left_out_and_said(fidelity, made, program, tmp_path):
    made("graph", 0.3)
    made("wrong", 0.2)
    assert fidelity("report", "logs", "--keep", "kept.json").rc == 0
    kept = read_kept(tmp_path / "kept.json")
    (wrong,) = kept["wrong"]
    other = RunSettings(wrong.configuration.components, {**wrong.configuration.settings, "study.wrong_loops": "0.25"})
    renamed = {"graph": kept["graph"], "wrong": [replace(wrong, configuration=other)], "once": [wrong]}
    write_kept(tmp_path / "kept.json", renamed)
    assert fidelity("report", "--keep", "kept.json").rc == 0
    text = (tmp_path / "fidelity.md").read_text()
    assert (
        "- not used: wrong, seed 0 (kept of pose_graph/wrong-0-0.2: study.wrong_loops was 0.25, and is 0.2 now)" in text
    )
    assert "- once was kept, and is no run of a claim" in text
    assert rows_of(text)["small"][3:5] == ["`ate` 0.3 m (one run)", "not measured"]
    assert read_kept(tmp_path / "kept.json").keys() == renamed.keys(), "nothing is thrown away"
    assert fidelity("run", "--logs", "again", "--keep", "kept.json").rc == 0
    assert [[word for word in call if "=" in word] for call in program()] == [
        ["experiment=pose_graph", "study.wrong_loops=0.2", "seed=0", "logs=again"]
    ]


def test_a_value_that_was_not_kept_is_asked_for(fidelity, made, tmp_path):
    made("graph", 0.3)
    assert fidelity("report", "logs", "--keep", "kept.json").rc == 0
    kept = read_kept(tmp_path / "kept.json")
    (run,) = kept["graph"]
    write_kept(tmp_path / "kept.json", {"graph": [replace(run, values={"ate": run.values["ate"]})]})
    assert fidelity("report", "--keep", "kept.json").rc == 0
    text = (tmp_path / "fidelity.md").read_text()
    assert rows_of(text)["cell"][5] == "**not measured**"
    assert (
        "nothing was kept of times.csv[method=b].ms / times.csv[method=a].ms of pose_graph/graph-0-0.3; run it again"
        in text
    )


def test_a_mistake_is_one_sentence(fidelity, tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "list.json").write_text("[]")
    for arguments, why in {
        ("report", "empty"): "empty holds no run",
        ("report", "nowhere"): "nowhere holds no run",
        ("report",): "give a folder of runs, or --keep FILE",
        ("report", "--keep", "list.json"): "list.json holds no kept measurements (the file should be a mapping)",
        ("report", "empty", "--claims", "smal"): "there is no claim 'smal' (did you mean small?)",
        ("run", "--seeds", "0"): "0 is no number of 1 to 1000",
    }.items():
        result = fidelity(*arguments)
        assert result.rc == 2
        assert why in result.stderr
        assert "Traceback" not in result.stderr


@pytest.fixture
def program(tmp_path, monkeypatch):
    """In place of Python: notes its arguments, and fails where something is wrong."""
    script = tmp_path / "program"
    script.write_text(
        '#!/bin/sh\necho "$@" >> calls\ncase "$*" in *wrong_loops*seed=1*) echo "omnilab: it is wrong; mend it" >&2; exit 2;; esac\n'
    )
    script.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(script))
    return lambda: [line.split() for line in (tmp_path / "calls").read_text().splitlines()]


def test_what_is_missing_is_run_cheapest_first_and_a_failure_stops_nothing(fidelity, made, program, tmp_path):
    made("graph", 0.3, seed=0)
    result = fidelity("run", "--logs", "logs", "--seeds", "2")
    assert result.rc == 1
    assert "wrong, seed 1: failed, it is wrong; mend it" in result.stderr
    assert "2 runs done, 1 failed" in result.stderr
    runs = [[word for word in call if "=" in word] for call in program()]
    assert [words[:-1] for words in runs] == [
        ["experiment=pose_graph", "study.wrong_loops=0.2", "seed=0"],
        ["experiment=pose_graph", "study.wrong_loops=0.2", "seed=1"],
        ["experiment=pose_graph", "seed=1"],
    ]
    assert all(words[-1] == "logs=logs" for words in runs)


def test_nothing_is_run_that_is_there_or_left_out(fidelity, made, program, tmp_path):
    made("graph", 0.3)
    result = fidelity("run", "--logs", "logs", "--minutes", "0.5")
    assert result.rc == 0
    assert "2 runs of more than 0.5 min are left out" in result.stderr
    made("wrong", 0.3)
    assert "nothing is missing; the table: omnilab fidelity report logs" in fidelity("run", "--logs", "logs").stderr
    assert not (tmp_path / "calls").exists()


def test_the_claims_are_listed(fidelity):
    result = fidelity("list", "--claims", "small")
    assert "at most 0.1" in result.stdout
    assert "omnilab experiment=pose_graph" in result.stdout
    assert "never" not in result.stdout


def test_an_interrupt_reaches_the_run_and_begins_no_other(fidelity, program, tmp_path):
    script = tmp_path / "program"
    script.write_text(
        "#!/bin/sh\ntrap 'echo ended=1 >> calls; kill $!; exit 130' INT\nsleep 30 2>/dev/null &\necho begun=1 >> calls\nwait\n"
    )

    def interrupt():
        while not (tmp_path / "calls").exists():
            time.sleep(0.02)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt).start()
    result = fidelity("run", "--logs", "logs")
    assert result.rc == 130
    assert program() == [["begun=1"], ["ended=1"]]
