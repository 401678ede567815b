"""Rerun's own program: it mends recordings here, and shows them in `viewer`."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

from omnilab.errors import DataError

TIMEOUT_S = 600.0


def binary() -> str:
    """The program itself, not the script of the same name, which would leave it running when it is ended."""
    spec = find_spec("rerun_cli")
    if spec is None or spec.origin is None:
        raise DataError("rerun-sdk lacks its program rerun_cli; run `pip install --force-reinstall rerun-sdk`")
    return str(Path(spec.origin).with_name("rerun.exe" if sys.platform == "win32" else "rerun"))


def quiet_environment() -> dict[str, str]:
    """Environment in which the program sends no usage statistics (as on CI) and finds no way to ask for updates."""
    return os.environ | {"CI": "1", "HTTPS_PROXY": "http://127.0.0.1:9", "NO_COLOR": "1"}


def repair(recording: Path) -> str | None:
    """Drop the torn tail of a recording and write its footer; None if it is complete or does not exist."""
    if not recording.exists() or _is_complete(recording):
        return None
    mended, size = recording.with_name("mended.rrd"), recording.stat().st_size
    try:
        log = _rrd("optimize", recording, "-o", mended).stderr
        if not _is_complete(mended):
            raise DataError(f"{recording} cannot be read back ({complaint(log)}); run the experiment again")
        mended.replace(recording)
    finally:
        mended.unlink(missing_ok=True)
    return (
        f"{recording.name} had no footer and was written anew, {size} bytes before and {recording.stat().st_size} now"
    )


def _is_complete(recording: Path) -> bool:
    """Whether it ends with its footer and holds a run. `verify` alone is content with an empty file."""
    from rerun.chunk import RrdReader

    if not recording.exists() or _rrd("verify", recording).returncode:
        return False
    try:
        return bool(RrdReader(recording).recordings())
    except RuntimeError:
        return False


def _rrd(command: str, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    call = [binary(), "rrd", command, *map(str, arguments)]
    try:
        return subprocess.run(
            call, capture_output=True, text=True, timeout=TIMEOUT_S, env=quiet_environment(), check=False
        )
    except subprocess.TimeoutExpired as error:
        raise DataError(f"`rerun rrd {command}` took more than {TIMEOUT_S:.0f} s; run it by hand") from error


def complaint(log: str) -> str:
    """What the program says was wrong: its first line about an error, or else its last line."""
    lines = log.strip().splitlines() or ["it says nothing"]
    return next((line for line in lines if "rror" in line or "panicked" in line), lines[-1]).strip()
