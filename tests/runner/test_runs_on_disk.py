"""What commands of plugins are told of the runs on disk."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from omnilab.api import Metric, Report
from omnilab.errors import DataError
from omnilab.hooks import RunSummary
from omnilab.runner.registry import Registry
from omnilab.runner.repair import RunsOnDisk
from omnilab.runner.run_folder import DONE, RunFolder, origin
from omnilab.runner.run_folder.progress import RunProgress

MANIFEST = {"experiment": "grid", "overrides": ["seed=3"], "components": {"descriptor": {"name": "radon"}}}


@pytest.fixture
def folder(tmp_path):
    run = RunFolder(tmp_path / "run")
    run.open(MANIFEST, "seed: 3\nstudy: {}\n")
    run.write(Report([Metric("rate", 0.5, "1")]))
    run.end(DONE)
    return run.folder.resolve()


def test_the_summary_is_what_the_folder_says(folder):
    found = RunsOnDisk(Registry()).summary(folder)
    assert replace(found, header="") == RunSummary(
        folder, DONE, "grid", ["seed=3"], {"descriptor": "radon"}, {"seed": 3, "study": {}}, {"rate": 0.5}
    )
    assert found.header.startswith("### grid: done\n\nrate **0.5**")


def test_the_header_of_a_run_that_was_killed_says_how_far_it_came(tmp_path):
    run = RunFolder(tmp_path / "run")
    run.open(MANIFEST, "seed: 3\nstudy: {}\n")
    run.close()
    run.folder.joinpath("progress.json").write_text(RunProgress("places", 12, 30).to_json())
    header = RunsOnDisk(Registry()).summary(run.folder).header
    assert header.splitlines()[0] == "### grid: killed, at places 12 of 30"


@pytest.mark.parametrize("damage", ["[", json.dumps(MANIFEST | {"overrides": 3}), ""])
def test_what_is_damaged_counts_as_not_there(folder, damage):
    for name in ("manifest.json", "config.yaml", "metrics.csv"):
        (folder / name).write_text(damage)
    assert RunsOnDisk(Registry()).summary(folder) == RunSummary(folder, DONE)


def test_a_folder_without_a_run_is_refused(tmp_path):
    with pytest.raises(DataError, match="holds no run"):
        RunsOnDisk(Registry()).summary(tmp_path)


@pytest.mark.parametrize(
    ("program", "typed"),
    [("/x/omnilab/__main__.py", "omnilab"), ("/x/bin/omnilab", "omnilab"), ("study.py", "study.py")],
)
def test_the_command_of_a_run_is_as_it_would_be_typed(monkeypatch, program, typed):
    monkeypatch.setattr("sys.argv", [program, "experiment=grid"])
    assert origin()["command"] == [typed, "experiment=grid"]
