"""When, where and with what a run was made."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any


def origin() -> dict[str, Any]:
    """When, where and with what a run is made: time, version, commit, Python, host."""
    return {
        "began": datetime.now(UTC).isoformat(timespec="seconds"),
        "omnilab": version("omnilab"),
        "commit": commit(),
        "python": platform.python_version(),
        "host": {"name": platform.node(), "system": platform.platform(), "cores": os.cpu_count()},
        "command": [_program(), *sys.argv[1:]],
    }


def _program() -> str:
    """As it would be typed: also where it was begun as `python -m omnilab`."""
    program = Path(sys.argv[0])
    return "omnilab" if program.match("omnilab/__main__.py") else program.name


def commit() -> str | None:
    """The commit of the source tree that omnilab runs from, with "+changes" if it was edited; None if installed."""
    source = Path(__file__).resolve().parents[3]
    if not (source / ".git").exists():
        return None
    git = ["git", "-C", str(source)]
    try:
        head = subprocess.run([*git, "rev-parse", "HEAD"], capture_output=True, text=True, timeout=5, check=True)
        changes = subprocess.run(
            [*git, "status", "--porcelain", "-uno"], capture_output=True, text=True, timeout=5, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return head.stdout.strip() + ("+changes" if changes.stdout.strip() else "")
