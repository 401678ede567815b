"""A run's recording over HTTP: all of it, also while the run goes on."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest

from omnilab.runner.run_folder import load_run

SLOWLY = ["experiment=quickstart", "study.query_count=60", "study.step_m=0.5", "sensor.size=64", "cache=off"]


def open_files():
    """What this process, and the service in it, has open."""
    return [str(file.readlink()) for file in Path("/proc/self/fd").iterdir() if file.is_symlink()]


def begun(logs):
    """The folder of the first run there, once it has begun."""
    while not (found := list(logs.glob("quickstart/*/status.json"))):
        time.sleep(0.05)
    return found[0].parent


@pytest.mark.slow  # a real run
def test_a_live_run_is_followed_to_its_end(serve):
    served = serve()
    logs = served.settings.logs
    command = [sys.executable, "-m", "omnilab", *SLOWLY, f"logs={logs}"]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    try:
        run = begun(logs)
        states = []
        with served.client.stream("GET", f"/recording/{served.app.state.service.path(run)}") as answer:
            received = bytearray()
            for part in answer.iter_raw():
                states.append(load_run(run).state)
                received += part
    finally:
        process.wait()
    assert states[0] == "running"
    assert load_run(run).state == "done"
    assert bytes(received) == (run / "run.rrd").read_bytes()


def test_a_finished_recording_is_sent_whole_under_both_names(serve, finished_runs):
    client = serve(logs=finished_runs).client
    run = begun(finished_runs)
    for name in (f"/recording/quickstart/{run.name}", f"/recording/quickstart/{run.name}/run.rrd"):
        answer = client.get(name)
        assert answer.content == (run / "run.rrd").read_bytes()
        assert answer.headers["content-type"] == "application/octet-stream"


def test_a_run_that_goes_on_is_left_when_the_reader_goes(serve, runs_on):
    """No thread and no file stays with a reader that is gone."""
    served = serve()
    run = served.settings.logs / "grid" / "a"
    run.mkdir(parents=True)
    (run / "run.rrd").write_bytes(b"RRF2 and more")
    process = runs_on(run)
    with served.client.stream("GET", "/recording/grid/a") as answer:
        parts = answer.iter_raw()
        assert next(parts) == b"RRF2 and more"
        with (run / "run.rrd").open("ab") as out:
            out.write(b", appended")
        assert next(parts) == b", appended"
    while any(name.endswith("a/run.rrd") for name in open_files()):
        time.sleep(0.05)
    process.kill()
    process.wait()
    assert served.client.get("/recording/grid/a").content == b"RRF2 and more, appended"


def test_what_is_no_recording_is_said(serve, tmp_path):
    served = serve()
    run = served.settings.logs / "grid" / "a"
    run.mkdir(parents=True)
    (run / "status.json").write_text('{"status": "done", "pid": 1}')
    (tmp_path / "secret.rrd").write_bytes(b"RRF2 of somebody else")
    answer = served.client.get("/recording/grid/a")
    assert answer.status_code == 404
    assert "has no recording" in answer.text
    (run / "run.rrd").symlink_to(tmp_path / "secret.rrd")
    assert served.client.get("/recording/grid/a").status_code == 404
    assert served.client.get("/recording/../secret.rrd").status_code == 404
