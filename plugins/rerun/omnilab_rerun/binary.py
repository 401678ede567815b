"""Rerun's own program: it mends recordings here, and shows them in `viewer`."""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterable
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from omnilab.errors import DataError
from omnilab.log_files import is_there, replace_mended, unmended

if TYPE_CHECKING:
    from omnilab_rerun.damage import DamagedRecording, Message

TIMEOUT_S = 600.0
MOST_CALLS = 200  # of the program, to find what it does not take


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
    """Write a torn or damaged recording anew with all its whole messages; None if it is whole or does not exist.

    A damaged one is kept beside, a torn one is not: what follows its last whole message is a part of one, or zeros.
    """
    from omnilab_rerun.damage import ARROW, DamagedRecording

    if not is_there(recording):
        return None
    size = recording.stat().st_size
    with recording.open("rb") as file:
        log = DamagedRecording(recording, file, size)
        if not log.gaps and _is_complete(recording):
            return None
        kept = _loadable(log)
        if not any(message.kind == ARROW for message in kept):
            raise DataError(f"{recording} cannot be read back (it holds no whole record); run the experiment again")
        torn = len(kept) == len(log.messages) and all(gap.torn for gap in log.gaps)
        aside = replace_mended(recording, lambda out: _write(log, kept, out), keep=not torn)
    if aside is None:
        now = recording.stat().st_size
        return f"{recording.name} had no whole footer and was written anew, {size} bytes before and {now} now"
    return f"{recording.name} was damaged: {_lost(log, kept, size)}; the damaged file is kept as {aside.name}"


def _write(log: DamagedRecording, kept: list[Message], out: BinaryIO) -> None:
    """Let the program write messages with their footer; DataError if it does not."""
    done = _rrd("filter", feed=log.bytes_of(kept), out=out)
    if done.returncode:
        number = re.search(r"\(os error (\d+)\)", done.stderr)
        ended = f"`rerun rrd filter` ended with code {done.returncode}"
        raise unmended(log.path, os.strerror(int(number[1])) if number else ended)
    if not _is_complete(Path(out.name)):
        raise unmended(log.path, "`rerun rrd filter` wrote what cannot be read back")


def join(parts: Iterable[Path], out: BinaryIO) -> None:
    """Write recordings, and the layouts in them, as one; DataError if the program cannot."""
    done = _rrd("merge", *parts, out=out)
    if done.returncode:
        raise DataError(f"the recordings cannot be written as one ({complaint(done.stderr)})")


def _loadable(log: DamagedRecording) -> list[Message]:
    """The messages that the program takes: it knows more of what should be in them. Those it refuses are found by halving."""
    calls = itertools.count()

    def taken(messages: list[Message]) -> list[Message]:
        if next(calls) == MOST_CALLS:
            raise DataError("the recording is damaged in too many places to be mended; it is as it was")
        if not messages or not _rrd("verify", "--check-footers", "false", feed=log.bytes_of(messages)).returncode:
            return messages
        if len(messages) == 1:
            return []
        half = len(messages) // 2
        return taken(messages[:half]) + taken(messages[half:])

    return taken(log.messages)


def _lost(log: DamagedRecording, kept: list[Message], size: int) -> str:
    """How much of a recording is not in the mended one, and when it was logged."""
    refused = set(log.messages) - set(kept)
    lost = sorted([(gap.start, gap.end) for gap in log.gaps] + [(message.start, message.end) for message in refused])
    count = sum(end - start for start, end in lost)
    before = [m.log_ns for m in kept if m.log_ns is not None and m.end <= lost[0][0]]
    after = [m.log_ns for m in kept if m.log_ns is not None and m.start >= lost[-1][1]]
    since = f" from {_clock(max(before))}" if before else ""
    until = f" to {_clock(min(after))}" if after else " to its end"
    return (
        f"{count} of {size} bytes could not be read, at bytes {lost[0][0]} to {lost[-1][1]}, logged{since}{until};"
        f" {len(kept)} messages were kept"
    )


def _clock(time_ns: int) -> str:
    """A time as one reads it: 2026-11-29 12:00:01.123 UTC."""
    return datetime.fromtimestamp(time_ns / 1e9, UTC).strftime("%Y-%m-%d %H:%M:%S.%f")[:-3] + " UTC"


def _is_complete(recording: Path) -> bool:
    """Whether it ends with its footer and holds a run. `verify` alone is content with an empty file."""
    from rerun.chunk import RrdReader

    if _rrd("verify", recording).returncode:
        return False
    try:
        return bool(RrdReader(recording).recordings())
    except RuntimeError:
        return False


def _rrd(
    command: str, *arguments: str | Path, feed: Iterable[bytes] = (), out: BinaryIO | None = None
) -> subprocess.CompletedProcess[str]:
    """Run `rerun rrd`, which reads what it is fed if no argument names a file."""
    call = [binary(), "rrd", command, *map(str, arguments)]
    with tempfile.TemporaryFile("w+", errors="replace") as log:
        process = subprocess.Popen(
            call, stdin=subprocess.PIPE, stdout=out or subprocess.DEVNULL, stderr=log, env=quiet_environment()
        )
        watch = threading.Timer(TIMEOUT_S, process.kill)
        watch.start()
        try:
            assert process.stdin is not None
            with contextlib.suppress(BrokenPipeError), process.stdin as pipe:  # it may have seen enough
                for part in feed:
                    pipe.write(part)
            process.wait()
        finally:
            late = not watch.is_alive()
            watch.cancel()
            process.kill()
            process.wait()
        if late:
            raise DataError(f"`rerun rrd {command}` took more than {TIMEOUT_S:.0f} s; run it by hand")
        log.seek(0)
        return subprocess.CompletedProcess(call, process.returncode, stderr=log.read())


def complaint(log: str) -> str:
    """What the program says was wrong: its first line about an error, or else its last line."""
    lines = log.strip().splitlines() or ["it says nothing"]
    return next((line for line in lines if "rror" in line or "panicked" in line), lines[-1]).strip()
