"""Runs of a study that ends as it is told, and disks that are full."""

from __future__ import annotations

import os
import resource
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest

PLUGIN = Path(__file__).with_name("omnilab_endings.py")
SCRIPT = Path(sys.executable).with_name("omnilab")
NO_LOGS = ["~sink@sinks.rerun", "~sink@sinks.mcap"]
ENDINGS = ["experiment=pose_graph", "~backend", "study=endings", *NO_LOGS]


class Ended(NamedTuple):
    """What a command in a shell left."""

    rc: int
    stdout: str
    stderr: str


@pytest.fixture
def endings(omnilab_here: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """`endings(*arguments)`: the study, in this process; `-m` first makes a sweep."""
    monkeypatch.setenv("OMNILAB_PLUGINS", str(PLUGIN))
    limit = resource.getrlimit(resource.RLIMIT_NOFILE)

    def run(*arguments: str) -> Any:
        mode = [one for one in arguments if one == "-m"]
        try:
            return omnilab_here(*mode, *ENDINGS, *(one for one in arguments if one != "-m"))
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, limit)

    return run


@pytest.fixture
def in_shell(tmp_path: Path) -> Callable[..., Ended]:
    """`in_shell("{omnilab} ... | head -1", disk="300k")`: a line of bash in tmp_path, `logs` a small disk if one is given.

    `{omnilab}` is the study by the installed command, `{command}` the command alone. The exit code is the command's.
    """
    environment = os.environ | {"OMNILAB_PLUGINS": str(PLUGIN)}

    def run(line: str, disk: str = "", timeout: float = 240) -> Ended:
        command = shlex.quote(str(SCRIPT))
        line = line.format(omnilab=shlex.join([str(SCRIPT), *ENDINGS]), command=command)
        script = f"{line}; code=${{PIPESTATUS[0]}}\nif [ -d logs ]; then cp -a logs kept; fi\nexit $code"
        call = ["bash", "-c", script]
        if disk:
            (tmp_path / "logs").mkdir(exist_ok=True)
            call = [*mounting(), "bash", "-c", f"mount -t tmpfs -o size={disk} tmpfs logs\n{script}"]
        done = subprocess.run(
            call, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=timeout, check=False
        )
        return Ended(done.returncode, done.stdout, done.stderr)

    return run


def mounting() -> list[str]:
    """What may mount a disk of its own; skips the test where none may."""
    call = ["unshare", "--mount", "--map-root-user"]
    if not shutil.which("unshare"):
        pytest.skip("there is no unshare to mount a small disk with")
    tried = subprocess.run(
        [*call, "mount", "-t", "tmpfs", "tmpfs", "/mnt"], capture_output=True, text=True, check=False
    )
    if tried.returncode:
        pytest.skip(f"no small disk can be mounted: {tried.stderr.strip()}")
    return call
