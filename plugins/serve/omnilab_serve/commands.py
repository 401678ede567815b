"""omnilab's own commands in processes of their own: what is too heavy for the service, which answers meanwhile."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import IO

from omnilab.errors import DataError

PROGRAM = (sys.executable, "-P", "-m", "omnilab")  # -P: as the command omnilab, which imports nothing from here
AT_ONCE = threading.BoundedSemaphore(2)  # processes; others wait for their turn
LIMIT_S = 300.0
LARGEST = 64 * 2**20  # bytes of output
LONGEST_COMPLAINT = 4096  # bytes of standard error
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")  # experiments go first


@dataclass(frozen=True)
class CommandOutput:
    """What a command that succeeded has printed."""

    out: bytes
    warnings: str  # on standard error, its last part


def run_command(words: Sequence[str], limit_s: float = LIMIT_S) -> CommandOutput:
    """Run `omnilab WORDS` and wait; DataError with its own sentence if it fails, takes too long or says too much."""
    name = f"omnilab {words[0]}"
    with AT_ONCE, tempfile.TemporaryFile() as complaint:
        child = subprocess.Popen(
            [*PROGRAM, *words], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=complaint,
            start_new_session=True, env={**os.environ, **ONE_THREAD, "NO_COLOR": "1"},
        )  # fmt: skip
        watch = threading.Timer(limit_s, _end, [child])
        watch.start()
        try:
            assert child.stdout is not None
            with child.stdout as stream:
                out = stream.read(LARGEST + 1)
        finally:
            late = not watch.is_alive()
            watch.cancel()
            if late or sys.exc_info()[0] or len(out) > LARGEST:
                _end(child)
            child.wait()
        warnings = _tail(complaint)
    if late:
        raise DataError(f"{name} took more than {limit_s:.0f} s and was ended; run it in a terminal")
    if len(out) > LARGEST:
        raise DataError(f"{name} printed more than {LARGEST >> 20} MiB; give fewer runs")
    if child.returncode:
        raise DataError(_sentence(warnings) or f"{name} ended with code {child.returncode}; run it in a terminal")
    return CommandOutput(out, warnings)


def _end(child: subprocess.Popen[bytes]) -> None:
    """End a child with all that it has started."""
    with suppress(ProcessLookupError):
        os.killpg(child.pid, signal.SIGKILL)


def _tail(file: IO[bytes]) -> str:
    size = file.seek(0, os.SEEK_END)
    file.seek(max(0, size - LONGEST_COMPLAINT))
    return file.read().decode(errors="replace").strip()


def _sentence(warnings: str) -> str:
    """what a command said last."""
    return warnings.splitlines()[-1].removeprefix("omnilab: ") if warnings else ""
