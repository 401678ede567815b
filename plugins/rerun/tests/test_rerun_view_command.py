"""The command `omnilab view`, as the plugin registers it, with runs that are made up."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

import omnilab_rerun
from omnilab.errors import DataError
from omnilab.hooks import RunSummary
from omnilab_rerun import RerunSink


class MadeUpRuns:
    """Says which folder was requested, and answers with another."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.requested: list[Path] = []
        self.state = "done"

    def ready(self, run: Path) -> Path:
        self.requested.append(run)
        return self.folder

    def summary(self, run: Path) -> RunSummary:
        return RunSummary(run, self.state, header="### grid: as it stands")


@pytest.fixture
def runs(tmp_path):
    return MadeUpRuns(tmp_path / "run")


@pytest.fixture
def command(runs):
    commands = {}
    omnilab_rerun.register_commands(commands.__setitem__, runs)
    assert list(commands) == ["view"]
    return commands["view"]


@pytest.fixture
def calls(monkeypatch):
    """The arguments of the sink's views, which do nothing."""
    found = []
    monkeypatch.setattr(RerunSink, "view", lambda self, folder, **options: found.append((folder, options)))
    return found


@pytest.mark.parametrize(("argv", "requested"), [([], "logs/latest"), (["logs/grid/1"], "logs/grid/1")])
def test_the_ready_folder_is_opened_in_the_viewer(command, runs, calls, capsys, argv, requested):
    assert command(argv) == 0
    assert runs.requested == [Path(requested)]
    assert calls == [(runs.folder, {"screenshot": None, "step": None, "header": ""})]
    assert capsys.readouterr() == ("", "")


def test_a_screenshot_is_named_on_standard_error(command, runs, calls, capsys):
    assert command(["--screenshot", "p.png", "--step", "95"]) == 0
    assert calls == [(runs.folder, {"screenshot": Path("p.png"), "step": 95, "header": ""})]
    assert capsys.readouterr() == ("", "omnilab: the picture is p.png\n")


@pytest.mark.parametrize("state", ["killed", "running", "silent"])
def test_a_run_that_could_not_say_how_it_stands_is_shown_with_what_its_folder_says(command, runs, calls, state):
    runs.state = state
    assert command([]) == 0
    assert calls == [(runs.folder, {"screenshot": None, "step": None, "header": "### grid: as it stands"})]


def test_a_run_without_recording_is_an_error(command):
    with pytest.raises(DataError, match=r"run\.rrd does not exist; run the experiment with the sink rerun"):
        command([])


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_it_in_good_order(command, monkeypatch, number):
    ended = []

    def view(self, folder, **options):
        try:
            os.kill(os.getpid(), number)
            signal.sigtimedwait([], 60)
        finally:
            ended.append(folder)

    monkeypatch.setattr(RerunSink, "view", view)
    before = signal.getsignal(number)
    with pytest.raises(SystemExit, match=str(128 + number)):
        command([])
    assert ended
    assert signal.getsignal(number) == before


def test_help_names_the_options(command, capsys):
    with pytest.raises(SystemExit, match="0"):
        command(["--help"])
    text = capsys.readouterr().out
    assert text.startswith("usage: omnilab view")
    assert "Open a run's recording in Rerun, or those of several side by side" in text
    assert "--screenshot FILE.png" in text
    assert "--step STEP" in text
