"""Standard output or error goes away, or cannot be written: results are complete, the status is true."""

from __future__ import annotations

from pathlib import Path

import pytest

from omnilab.runner.run_folder import load_run

METRICS = "metric,value,unit,low,high,note\nprecious,0.123456789,m,0.1,0.2,\nnothing,,1,,,none\n"
NOISE = ("Traceback", "Exception ignored", "BrokenPipe", "Errno", "Logging error")


def check_done(tmp_path: Path) -> None:
    folder = tmp_path / "logs" / "latest"
    assert load_run(folder).status["status"] == "done"
    assert (folder / "metrics.csv").read_text() == METRICS
    assert (folder / "third.png").exists()


@pytest.mark.parametrize(
    "redirection",
    [
        "2> >(head -c 10 >/dev/null)",
        "2>/dev/full",
        pytest.param("2>&-", marks=pytest.mark.slow),
        pytest.param("2> >(exit)", marks=pytest.mark.slow),
        pytest.param("+sink@sinks.last=closing sinks.last.how=bug 2>/dev/full", marks=pytest.mark.slow),
        pytest.param("</dev/null 0<&- 2>&-", marks=pytest.mark.slow),
    ],
)
def test_without_a_reader_of_standard_error(in_shell, tmp_path, redirection):
    ended = in_shell(f"{{omnilab}} study.say=100 {redirection}")
    assert ended.rc == 0
    assert "precious" in ended.stdout
    check_done(tmp_path)


@pytest.mark.parametrize(
    "redirection",
    [
        "| head -1",
        pytest.param("| true", marks=pytest.mark.slow),
        pytest.param(">&-", marks=pytest.mark.slow),
        pytest.param(">&- 2>&-", marks=pytest.mark.slow),
    ],
)
def test_without_a_reader_of_standard_output(in_shell, tmp_path, redirection):
    ended = in_shell(f"{{omnilab}} study.say=2 {redirection}")
    assert ended.rc == 0, ended.stderr
    assert not [word for word in NOISE if word in ended.stderr]
    check_done(tmp_path)


def test_on_a_full_disk_behind_standard_output_metrics_are_on_standard_error(in_shell, tmp_path):
    ended = in_shell("{omnilab} >/dev/full")
    assert ended.rc == 2
    assert not [word for word in NOISE if word in ended.stderr]
    assert "precious" in ended.stderr
    assert ended.stderr.splitlines()[-1] == (
        "omnilab: standard output cannot be written (No space left on device); make room there, or give another place"
    )
    check_done(tmp_path)


@pytest.mark.slow
def test_when_neither_can_be_written(in_shell, tmp_path):
    assert in_shell("{omnilab} study.say=3 >/dev/full 2>/dev/full").rc == 2
    check_done(tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize(
    "command", ["runs", "plugins", "plugins mirror", "--version", "--help", "runs --help", "experiment=grid --cfg job"]
)
@pytest.mark.parametrize(("redirection", "rc"), [("| true", 0), (">/dev/full", 2), (">&-", 0)])
def test_other_commands(in_shell, tmp_path, command, redirection, rc):
    (tmp_path / "logs").mkdir()
    ended = in_shell(f"{{command}} {command} {redirection}")
    assert ended.rc == rc, ended.stderr
    assert not [word for word in NOISE if word in ended.stderr]


@pytest.mark.slow
@pytest.mark.parametrize("redirection", ["2>/dev/full", "2> >(exit)", "2>&-", "2>&1 | true"])
@pytest.mark.parametrize(
    ("arguments", "rc"),
    [("study.how=full", 2), ("study.how=exit", 2), ("study.how=bug", 1), ("study.how=SIGTERM", 130), ("seed=nope", 2)],
)
def test_a_failure_that_nobody_reads(in_shell, tmp_path, arguments, rc, redirection):
    assert in_shell(f"{{omnilab}} {arguments} {redirection}").rc == rc
    if arguments != "seed=nope":
        assert load_run(tmp_path / "logs" / "latest").status["status"] != "running"
