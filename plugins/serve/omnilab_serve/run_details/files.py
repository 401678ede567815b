"""The files of a run's folder, which a stranger may have written: each is looked at before it is opened, and bounded."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from io import FileIO
from itertools import islice
from pathlib import Path

from omnilab.client import RunFile
from omnilab.runner.run_folder.names import STATUS
from omnilab.runner.sweeps.plan_file import PLAN

RECORDING = "run.rrd"
PNG = b"\x89PNG\r\n\x1a\n"
TEXTS = {".log", ".csv", ".yaml", ".json", ".jsonl", ".txt", ".md", ".g2o", ".tum"}
CHUNK = 1 << 18  # bytes
BYTES = "application/octet-stream"
MOST_FILES = 1000  # that are listed
HIDDEN = (".part", ".reserved")  # ends of names of what a run is about to write


def open_file(file: Path) -> FileIO:
    """A regular file, open; OSError for anything else. Never waits for a pipe, nor follows a link."""
    descriptor = os.open(file, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise OSError(errno.EINVAL, "it is no file")
    return FileIO(descriptor)


def file_of(path: str, logs: Path) -> FileIO | None:
    """The file at a path below the logs, open; None for one that is no regular file within the folder of a run or sweep.

    The folder is the first on the way that is one; links are resolved, and none leads out of it.
    """
    parts = path.split("/")
    if "" in parts or ".." in parts or "\0" in path:
        return None
    try:
        root = logs.resolve()
        for depth in range(1, len(parts)):
            folder = root.joinpath(*parts[:depth]).resolve()
            if folder.is_relative_to(root) and any((folder / name).is_file() for name in (STATUS, PLAN)):
                file = folder.joinpath(*parts[depth:]).resolve()
                return open_file(file) if file.is_relative_to(folder) else None
    except (OSError, RuntimeError):  # nothing is there, a circle of links, a pipe, not ours to read
        return None
    return None


def media_type(name: str, begins: bytes) -> str:
    """What a browser may take a file for: a picture by how it begins, a text by its name, all else for bytes to be saved."""
    if begins.startswith(PNG):
        return "image/png"
    return "text/plain; charset=utf-8" if Path(name).suffix.lower() in TEXTS else BYTES


def content(file: FileIO, size: int) -> Iterator[bytes]:
    """The first bytes of an open file, in pieces."""
    while size > 0 and (part := file.read(min(CHUNK, size))):
        size -= len(part)
        yield part


def run_files(folder: Path) -> Sequence[RunFile]:
    """The regular files of a run, by name; those in folders below it too, but for links."""
    found = [file for path in islice(_paths(folder), MOST_FILES) if (file := _run_file(path, folder))]
    return sorted(found, key=lambda file: ("/" in file.name, file.name))


def _paths(folder: Path) -> Iterator[Path]:
    return (Path(place, name) for place, _, names in os.walk(folder) for name in names if not name.endswith(HIDDEN))


def _run_file(file: Path, folder: Path) -> RunFile | None:
    """None for what is no file, and for one that a run has renamed meanwhile."""
    try:
        about = file.lstat()
        changed = datetime.fromtimestamp(about.st_mtime, UTC).isoformat(timespec="seconds")
    except (OSError, ValueError, OverflowError):  # a time that no calendar has
        return None
    name = file.relative_to(folder).as_posix().encode("utf-8", "backslashreplace").decode()  # it may be no text
    return RunFile(name, about.st_size, changed) if stat.S_ISREG(about.st_mode) else None
