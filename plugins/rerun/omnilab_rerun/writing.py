"""Rerun's writer, a thread of its own that ends without a word when the disk is full, as seen from outside."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import rerun as rr
from rerun_bindings import flush_and_cleanup_orphaned_recordings

CLOSE_S = 20.0  # how long what is left may take to be written
DEAD_S = 1.0  # how long a writer that has let go of its file is waited for
FOOTER = b"RRF2FOOT"
FOOTER_END = 4  # bytes behind it


class RecordingFile:
    """A recording that is being written."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._identity = _identity(path.stat())
        mine = (int(entry.name) for entry in Path("/dev/fd").iterdir())
        self._descriptor = next(filter(self._is_it, mine))

    def is_written(self) -> bool:
        """Whether Rerun still has it open."""
        return self._is_it(self._descriptor)

    def is_whole(self) -> bool:
        """Whether it ends with a footer."""
        with self._path.open("rb") as file:
            file.seek(0, os.SEEK_END)
            file.seek(-min(file.tell(), len(FOOTER) + FOOTER_END), os.SEEK_END)
            return file.read().startswith(FOOTER)

    def _is_it(self, descriptor: int) -> bool:
        try:
            return _identity(os.fstat(descriptor)) == self._identity
        except OSError:  # closed meanwhile
            return False


def _identity(status: os.stat_result) -> tuple[int, int]:
    return status.st_dev, status.st_ino


def end(stream: rr.RecordingStream, file: RecordingFile) -> None:
    """Let a stream write what is left, and its threads end. A dead writer is not waited for, nor one that hangs."""
    ending = threading.Thread(target=stream.disconnect, daemon=True)
    ending.start()
    limit = time.monotonic() + CLOSE_S
    while ending.is_alive() and time.monotonic() < limit:
        if not file.is_written():
            limit = min(limit, time.monotonic() + DEAD_S)
        ending.join(DEAD_S / 10)
    if ending.is_alive():
        rr.unregister_shutdown()  # Python would wait for it when the process ends
        return
    del ending, stream
    flush_and_cleanup_orphaned_recordings()  # otherwise two threads remain of each job of a sweep
