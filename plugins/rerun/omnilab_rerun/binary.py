"""Rerun's own program: it mends recordings here, and shows them in `viewer`."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

from omnilab.errors import DataError

MEND_TIMEOUT_S = 600.0


def binary() -> str:
    """The program itself, not the script of the same name, which would leave it running when it is ended."""
    spec = find_spec("rerun_cli")
    if spec is None or spec.origin is None:
        raise DataError(
            "the package rerun-sdk lacks its program rerun_cli; run `pip install --force-reinstall rerun-sdk`"
        )
    return str(Path(spec.origin).with_name("rerun.exe" if sys.platform == "win32" else "rerun"))


def quiet_environment() -> dict[str, str]:
    """Environment in which the program sends no usage statistics (as on CI) and does not look for a newer version."""
    return os.environ | {"CI": "1", "HTTPS_PROXY": "http://127.0.0.1:9"}


def repair(recording: Path) -> str | None:
    """Drop the torn tail of a recording and write its footer; None if it is complete or does not exist."""
    if not recording.exists() or _rrd("verify", recording).returncode == 0:
        return None
    mended = recording.with_name("mended.rrd")
    try:
        told = _rrd("optimize", recording, "-o", mended)
        if not mended.exists() or _rrd("verify", mended).returncode:
            raise DataError(f"{recording} cannot be read back ({_last_line(told.stderr)}); run the experiment again")
        lost = recording.stat().st_size
        mended.replace(recording)
    finally:
        mended.unlink(missing_ok=True)
    return f"{recording.name} had no footer: rewritten, {lost} bytes became {recording.stat().st_size}"


def _rrd(command: str, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    call = [binary(), "rrd", command, *map(str, arguments)]
    return subprocess.run(
        call, capture_output=True, text=True, timeout=MEND_TIMEOUT_S, env=quiet_environment(), check=False
    )


def _last_line(text: str) -> str:
    return text.strip().rpartition("\n")[-1]
