"""The process that composes: one at most, replaced when it dies or hangs, ended when nobody asks."""

import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from omnilab.client import SubmissionRequest
from omnilab_serve.composing import Composer, ComposerError, SettingError, check_request
from omnilab_serve.settings import ServeSettings

pytestmark = pytest.mark.slow  # each waits for a process that imports the plugins

ECHO = """
import json, os, sys, time
for line in sys.stdin:
    asked = json.loads(line)["arguments"]
    if asked["overrides"] == ["die"]:
        os._exit(7)
    if asked["overrides"] == ["hang"]:
        time.sleep(1000)
    print(json.dumps({"result": asked["overrides"]}), flush=True)
"""


@pytest.fixture
def composer(tmp_path):
    """Starts composers; `ECHO` stands in for the plugins of one."""
    made = []

    def make(*command, **limits):
        given = {"command": command} if command else {}
        made.append(Composer(ServeSettings(logs=tmp_path), **given, **limits))
        return made[-1]

    yield make
    for each in made:
        each.stop()


def is_running(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def wait_until(condition):
    while not condition():
        time.sleep(0.02)


def test_it_is_started_when_needed_once_and_ended_with_the_service(composer):
    echo = composer(sys.executable, "-c", ECHO)
    assert echo.pid is None
    assert echo.check(["a"], "basic") == ["a"]
    pid = echo.pid
    assert echo.check(["b"], "basic") == ["b"]
    assert echo.pid == pid
    echo.stop()
    assert echo.pid is None
    assert not is_running(pid)


def test_one_that_dies_is_replaced_and_that_is_said(composer):
    echo = composer(sys.executable, "-c", ECHO)
    with pytest.raises(ComposerError, match="died over this"):
        echo.check(["die"], "basic")
    assert echo.check(["next"], "basic") == ["next"]


def test_one_that_died_meanwhile_is_replaced_unnoticed(composer):
    echo = composer(sys.executable, "-c", ECHO)
    echo.check(["a"], "basic")
    first = echo.pid
    os.kill(first, 9)
    os.waitid(os.P_PID, first, os.WEXITED | os.WNOWAIT)
    assert echo.check(["b"], "basic") == ["b"]
    assert echo.pid != first


def test_one_that_hangs_is_ended_in_time_and_that_is_said(composer):
    echo = composer(sys.executable, "-c", ECHO, limit_s=2.0)
    echo.check(["a"], "basic")
    pid = echo.pid
    with pytest.raises(ComposerError, match="did not answer within 2 s and was ended"):
        echo.check(["hang"], "basic")
    assert not is_running(pid)
    assert echo.check(["next"], "basic") == ["next"]


def test_it_ends_with_the_service_whatever_it_does(composer):
    echo = composer(sys.executable, "-c", ECHO)
    with ThreadPoolExecutor(2) as threads:
        waiting = [threads.submit(echo.check, ["hang"], "basic") for _ in range(2)]  # the second for the first
        wait_until(lambda: echo.pid is not None)
        pid = echo.pid
        echo.stop()
        for each in waiting:
            with pytest.raises(ComposerError, match="the service is ending"):
                each.result()
    assert not is_running(pid)


def test_it_ends_when_nobody_asks(composer):
    echo = composer(sys.executable, "-c", ECHO, idle_s=0.2)
    echo.check(["a"], "basic")
    wait_until(lambda: echo.pid is None)
    assert echo.check(["b"], "basic") == ["b"]


PRINTING = """
import os
from omnilab import hookimpl
print("this plugin prints")
os.write(1, b'{"result": "forged"}\\n')

@hookimpl
def register_descriptors(register):
    raise ValueError("and fails\\nin two lines")
"""


def test_what_plugins_print_is_no_answer_and_one_that_fails_is_told(composer, tmp_path, monkeypatch, capfd):
    (tmp_path / "loud.py").write_text(PRINTING)
    monkeypatch.setenv("OMNILAB_PLUGINS", str(tmp_path / "loud.py"))
    found = composer().catalog()
    (failure,) = found["failures"]
    assert "ValueError: and fails in two lines" in failure["sentence"]
    assert "Traceback" in failure["traceback"]
    assert "radon" in [each["name"] for each in found["components"]]
    assert "this plugin prints" in capfd.readouterr().err


def test_the_worker_ends_with_whoever_started_it(tmp_path):
    code = f"""
import os, sys
from pathlib import Path
from omnilab_serve.composing import Composer
from omnilab_serve.settings import ServeSettings
composer = Composer(ServeSettings(logs=Path({str(tmp_path)!r})))
composer.catalog()
print(composer.pid, flush=True)
os.kill(os.getpid(), 9)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == -9
    wait_until(lambda: not is_running(int(done.stdout)))


def test_the_service_imports_no_plugin():
    code = (
        "import omnilab_serve.app, sys; print({m.partition('.')[0] for m in sys.modules if m.startswith('omnilab_')})"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "{'omnilab_serve'}"


def test_requests_are_checked_by_it(composer):
    checked = check_request(SubmissionRequest(["experiment=quickstart", "seed=1,2"], launcher="joblib"), composer())
    assert (checked.experiment, checked.jobs, checked.is_sweep) == ("quickstart", 2, True)
    assert checked.line == "omnilab -m experiment=quickstart seed=1,2 hydra/launcher=joblib"
    assert checked.swept == {"seed": ["1", "2"]}
    with pytest.raises(SettingError, match="is out of range; give a number above 0, or null") as refused:
        check_request(SubmissionRequest(["experiment=quickstart", "study.step_m=-1"]), composer())
    assert refused.value.setting == "study.step_m"
