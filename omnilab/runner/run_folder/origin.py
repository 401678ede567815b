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

HEAD, NO_COMMIT = "# branch.oid ", "(initial)"  # as git writes them, docs: git-status, porcelain format version 2


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
    words = ["git", "-C", str(source), "status", "--porcelain=v2", "--branch", "--untracked-files=no"]
    try:
        found = subprocess.run(words, capture_output=True, text=True, timeout=5, check=True).stdout.splitlines()
    except (OSError, subprocess.SubprocessError):
        return None
    head = next((line.removeprefix(HEAD) for line in found if line.startswith(HEAD)), NO_COMMIT)
    if head == NO_COMMIT:
        return None
    return head + ("" if all(line.startswith("# ") for line in found) else "+changes")
