"""Runs of the command line, apart from one another: in a process of their own, or in this one with its state put back."""

from __future__ import annotations

import contextlib
import gc
import importlib.util
import io
import logging
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import pytest
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra

from omnilab.api import KINDS
from omnilab.runner.cli import main

SCRIPT = Path(sys.executable).with_name("omnilab")
signal.signal(
    signal.SIGINT, signal.default_int_handler
)  # a job in a shell's background ignores it, and so would its children
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # or each of our processes would compile all it imports


def pytest_collection_finish() -> None:
    """What was imported stays: looking through it for garbage, again and again, takes a tenth of the time."""
    gc.collect()
    gc.freeze()


class Result(NamedTuple):
    """What a command left: its exit code and what it printed."""

    rc: int
    stdout: str
    stderr: str


@pytest.fixture(autouse=True)
def _state(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Every test starts without OMNILAB_PLUGINS and without components in Hydra's store, and leaves no trace."""
    monkeypatch.delenv("OMNILAB_PLUGINS", raising=False)
    monkeypatch.setattr(sys, "argv", sys.argv)
    modules, level = set(sys.modules), logging.getLogger("omnilab").level
    yield
    for kind in KINDS:
        ConfigStore.instance().repo.pop(kind, None)
    GlobalHydra.instance().clear()
    os.environ.pop("HYDRA_FULL_ERROR", None)  # every experiment sets it
    logging.getLogger("omnilab").setLevel(level)
    for name in set(sys.modules) - modules:
        if name.startswith("omnilab.runner.plugin_files."):
            del sys.modules[name]


@pytest.fixture(scope="session")
def omnilab_in() -> Callable[..., Result]:
    """`omnilab_in(folder, *arguments, env={...}, timeout=120)`: the installed command, in a process of its own."""

    def run(folder: Path, *arguments: str, env: Mapping[str, str] | None = None, timeout: float = 120) -> Result:
        clean = {name: value for name, value in os.environ.items() if name != "OMNILAB_PLUGINS"}
        done = subprocess.run(
            [SCRIPT, *arguments],
            cwd=folder,
            env=clean | dict(env or {}),
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
        )
        return Result(done.returncode, done.stdout, done.stderr)

    return run


@pytest.fixture
def omnilab(omnilab_in: Callable[..., Result], tmp_path: Path) -> Callable[..., Result]:
    """`omnilab(*arguments, env={...}, timeout=120)`: the installed command in tmp_path."""
    return partial(omnilab_in, tmp_path)


@pytest.fixture(scope="session")
def omnilab_at() -> Callable[..., Result]:
    """`omnilab_at(folder, *arguments)`: the command in a folder and in this process, for fixtures that several tests share."""

    def run(folder: Path, *arguments: str) -> Result:
        out, err = io.StringIO(), io.StringIO()
        here = contextlib.chdir(folder)
        with here, contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), pytest.raises(SystemExit) as end:
            main(arguments)
        assert isinstance(end.value.code, int)
        return Result(end.value.code, out.getvalue(), err.getvalue())

    return run


@pytest.fixture
def omnilab_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., Result]:
    """`omnilab_here(*arguments)`: the command in tmp_path and in this process, quick; for what needs no signals."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str) -> Result:
        with pytest.raises(SystemExit) as end:
            main(arguments)
        out, err = capsys.readouterr()
        assert isinstance(end.value.code, int)
        return Result(end.value.code, out, err)

    return run


@pytest.fixture(scope="session")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Path], Path]:
    """`installed(source)`: a folder for PYTHONPATH with the distribution of a source tree, of which no copy is left."""

    def installed(source: Path) -> Path:
        copy, target = tmp_path_factory.mktemp("source") / "omnilab-tiny", tmp_path_factory.mktemp("installed")
        shutil.copytree(source, copy, ignore=shutil.ignore_patterns("__pycache__"))
        command = [*installer(), "--quiet", "--no-deps", "--target", str(target), str(copy)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
        assert done.returncode == 0, done.stderr
        shutil.rmtree(copy)
        return target

    return installed


def installer() -> list[str]:
    """What installs packages beside the interpreter that runs the tests: uv, else pip."""
    if uv := os.environ.get("UV") or shutil.which("uv"):
        return [uv, "pip", "install", "--python", sys.executable]
    if importlib.util.find_spec("pip"):
        return [sys.executable, "-m", "pip", "install"]
    pytest.skip("neither uv nor pip is there to install a distribution with")
