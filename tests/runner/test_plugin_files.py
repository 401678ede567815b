"""Plugins named by OMNILAB_PLUGINS: advice about them works, none can end or hold omnilab, and workers find them."""

from __future__ import annotations

import os
import pickle
import re
import shlex
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from omnilab.errors import ConfigError
from omnilab.runner import interrupts
from omnilab.runner.registry import discover
from omnilab.runner.run_folder import find_runs

MINE = '''
from dataclasses import dataclass
import numpy as np
from omnilab import Signatures, hookimpl

@dataclass
class Mine:
    """The mean of each row."""
    view, color, rotation, default_distance = "panorama", False, "invariant", "euclidean"

    def describe(self, images):
        return Signatures(images.mean(axis=2, dtype=np.float32))

@hookimpl
def register_descriptors(register):
    register("mine", Mine)
'''
LOOK = "from omnilab import hookimpl\n@hookimpl\ndef register_commands(register): register('look', lambda argv: 0)\n"


@pytest.fixture
def write(tmp_path):
    """`write(name, text)`: the path of a plugin's file."""

    def write(name, text):
        (tmp_path / name).write_text(text)
        return str(tmp_path / name)

    return write


def advised(registry):
    """The value of OMNILAB_PLUGINS that the one failure advises."""
    (failure,) = registry.failures
    (assignment,) = shlex.split(re.search(r"leave one plugin out with (.*)$", failure.sentence)[1])
    return assignment.removeprefix("OMNILAB_PLUGINS=")


# ------------------------------------------------------------------------------------------------------- advice
@pytest.mark.parametrize("text", [MINE, LOOK], ids=["component", "command"])
@pytest.mark.parametrize("names", [("dup.py", "dup2.py"), ("a/dup.py", "b/dup.py"), ("my dup.py", "it's.py")])
def test_the_advice_about_a_name_taken_twice_works(tmp_path, write, text, names):
    (tmp_path / "a").mkdir(), (tmp_path / "b").mkdir()
    first, second = (write(name, text) for name in names)
    registry = discover(f"none,{first},{second}")
    assert f"registered already by plugin '{Path(first).stem}' ({first})" in registry.failures[0].sentence
    value = advised(registry)
    assert value == f"none,{first}"
    after = discover(value)
    assert not after.failures
    assert ("descriptor", "mine") in after.components or "look" in after.commands


def test_a_file_is_left_out_by_its_name_or_its_path(write):
    first, second = write("dup.py", MINE), write("dup2.py", MINE)
    for word in ("dup2", second):
        registry = discover(f"none,{first},{second},-{word}")
        assert not registry.failures
        assert registry.get("descriptor", "mine").plugin.name == "dup"


def test_the_advice_keeps_what_the_variable_says_already(write):
    taken = write("taken.py", MINE.replace('"mine"', '"radon"'))
    registry = discover(f"{taken},-mcap")
    assert advised(registry) == "-mcap"
    assert not discover("-mcap").failures


def test_a_file_named_twice_is_one(write, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    registry = discover(f"none,{write('dup.py', MINE)},dup.py,./dup.py")
    assert not registry.failures


def test_none_leaves_all_out_but_those_that_are_named():
    registry = discover("none,mcap")
    assert {component.plugin.name for component in registry.components.values()} == {"mcap"}


def test_a_file_in_the_home_folder(write, tmp_path, monkeypatch):
    write("dup.py", MINE)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert discover("none,~/dup.py").names("descriptor") == ["mine"]


def test_a_word_that_is_no_plugin_is_named():
    with pytest.raises(
        ConfigError, match=r"names '-dup2', which is no plugin; give file.py, none, or - and one of .*mcap"
    ):
        discover("-dup2")


# ------------------------------------------------------------------------------------------- failures are mentioned
@pytest.mark.parametrize(
    "arguments",
    [["plugins", "mine"], ["descriptor=mine"], ["experiment=mine"], ["mine"], ["veiw"],
     ["+sink@sinks.mine=mine"], ["sensor=mine"]],
    ids=" ".join,
)  # fmt: skip
def test_plugins_that_failed_are_mentioned_where_a_name_is_not_there(omnilab_here, write, monkeypatch, arguments):
    monkeypatch.setenv("OMNILAB_PLUGINS", write("broken.py", "import nowhere_to_be_found"))
    result = omnilab_here(*arguments)
    assert result.rc == 2
    assert result.stderr.splitlines()[-1].endswith("; not loaded: broken (omnilab plugins -v says why)")


# ------------------------------------------------------------------------------------------- what ends or holds
@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("class PanicException(BaseException): pass\nraise PanicException('index out of range')",
         "PanicException: index out of range"),
        ("raise KeyboardInterrupt", "KeyboardInterrupt"),
        ("raise GeneratorExit", "GeneratorExit"),
        ("import pytest; pytest.exit('no')", "Exit: no"),
        ("import pytest; pytest.skip('no', allow_module_level=True)", "Skipped: no"),
        ("import asyncio; raise asyncio.CancelledError", "CancelledError"),
        (MINE + "@hookimpl\ndef register_sinks(register): raise KeyboardInterrupt('mine')", "KeyboardInterrupt: mine"),
    ],
    ids=range(7),
)  # fmt: skip
def test_whatever_a_plugin_raises_is_its_failure_alone(write, text, told):
    registry = discover(f"none,{write('panics.py', text)},{write('good.py', MINE)}")
    (failure,) = registry.failures
    assert failure.sentence.endswith(f"not loaded: {told}")
    assert registry.names("descriptor") == ["mine"]


def test_the_list_of_plugins_survives_it(omnilab_here, write, monkeypatch):
    monkeypatch.setenv("OMNILAB_PLUGINS", write("panics.py", "raise KeyboardInterrupt"))
    result = omnilab_here("plugins")
    assert result.rc == 1
    assert "radon" in result.stdout
    assert result.stderr.endswith("panics.py) not loaded: KeyboardInterrupt\n")


@pytest.fixture
def ctrl_c(monkeypatch):
    """`ctrl_c(after_s)`: presses it in so many seconds; what is imported for 0.3 s is slow."""
    monkeypatch.setattr(interrupts, "SLOW_S", 0.3)
    timers = []

    def press(after_s):
        main = threading.main_thread().ident
        timers.append(threading.Timer(after_s, lambda: signal.pthread_kill(main, signal.SIGINT)))
        timers[-1].start()

    yield press
    for timer in timers:
        timer.join()


@pytest.mark.parametrize("after_s", [0.1, 0.6], ids=["waits until it is slow", "is slow"])
@pytest.mark.parametrize("text", ["import time; time.sleep(20)", "while True: pass"], ids=["sleeps", "loops"])
@pytest.mark.parametrize("command", [["experiment=map"], ["plugins"]], ids=["run", "plugins"])
def test_a_plugin_that_hangs_is_named_and_ctrl_c_ends_it(
    omnilab_here, write, monkeypatch, ctrl_c, text, after_s, command
):
    path = write("hangs.py", text)
    monkeypatch.setenv("OMNILAB_PLUGINS", f"none,{path}")
    start = time.monotonic()
    ctrl_c(after_s)
    result = omnilab_here(*command)
    assert result.rc == 130
    assert time.monotonic() - start < 15
    assert result.stderr.splitlines()[0] == (
        f"omnilab: plugin 'hangs' ({path}) is still being imported; Ctrl-C ends this, and OMNILAB_PLUGINS=none leaves it out"
    )
    assert "interrupted" in result.stderr.splitlines()[-1]


def test_a_plugin_that_swallows_ctrl_c_is_ended_by_the_third(omnilab_in, write, tmp_path):
    path = write(
        "swallows.py",
        "import os, signal, time\nfrom omnilab.runner import interrupts\n"
        "while True:\n    try:\n        time.sleep(0.2)\n"
        "        if interrupts._slow.is_set(): os.kill(os.getpid(), signal.SIGINT)\n    except BaseException: pass\n",
    )
    env = os.environ | {"OMNILAB_PLUGINS": f"none,{path}"}
    script = "from omnilab.runner import interrupts; interrupts.SLOW_S = 0.3\nfrom omnilab.runner.cli import main; main(['plugins'])"
    done = subprocess.run(
        [sys.executable, "-c", script], env=env, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 130
    assert "still being imported" in done.stderr


def test_a_quick_plugin_is_not_mentioned(write, capsys):
    discover(f"none,{write('good.py', MINE)}")
    assert capsys.readouterr() == ("", "")
    assert not [thread for thread in threading.enumerate() if isinstance(thread, threading.Timer)]


# ------------------------------------------------------------------------------------------------------- workers
def test_another_process_finds_the_class_of_a_file(write):
    path = write("my-own.v2.py", MINE)
    cls = discover(f"none,{path}").get("descriptor", "mine").cls
    script = "import pickle, sys; sys.stdout.write(pickle.load(sys.stdin.buffer).__doc__)"
    done = subprocess.run(
        [sys.executable, "-c", script], env=os.environ | {"OMNILAB_PLUGINS": f"none,{path}"},
        input=pickle.dumps(cls), capture_output=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.stdout.decode() == "The mean of each row.", done.stderr.decode()


@pytest.mark.slow
def test_a_parallel_launcher_takes_plugins_of_a_file(omnilab_in, write, tmp_path):
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher", reason="hydra-joblib-launcher is not installed")
    rng, folder = np.random.default_rng(0), tmp_path / "data"
    folder.mkdir()
    lines = ["image,x_m,y_m,yaw_deg"]
    for i in range(15):
        picture = cv2.resize(rng.integers(0, 255, (9, 9), dtype=np.uint8), (64, 64), interpolation=cv2.INTER_CUBIC)
        cv2.imwrite(str(folder / f"{i:02d}.png"), picture)
        lines.append(f"{i:02d}.png,{i % 5 / 2},{i // 5 / 2},0")
    (folder / "positions.csv").write_text("\n".join(lines) + "\n")
    result = omnilab_in(
        tmp_path, "-m", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2", "experiment=recorded_grid",
        f"sensor.path={folder}", "sensor.circle_px=[31.5,31.5,32]", "descriptor=mine,radon", "study.show=1",
        "~sinks.rerun", "~sinks.mcap",
        env={"OMNILAB_PLUGINS": f"{write('own.py', MINE)},{write('broken.py', 'import nowhere_to_be_found')}"},
    )  # fmt: skip
    assert result.rc == 0, result.stderr
    assert [run.state for run in find_runs(tmp_path / "logs")] == ["done", "done"]
