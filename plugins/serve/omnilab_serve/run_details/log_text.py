"""The end of a run's log."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from omnilab.client import LogTail
from omnilab.errors import visible
from omnilab.runner.run_folder.names import RUN_LOG
from omnilab_serve.run_details.files import open_file

LINES = 200
MOST_BYTES = 1 << 17
LONGEST = 2000  # characters of a line
TRACEBACK = "Traceback (most recent call last):"
ENTRY = re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d,\d{3} ")  # how an entry begins


@dataclass(frozen=True)
class LogPassage:
    """Some lines of a log that belong together."""

    text: str
    is_traceback: bool


def log_tail(folder: Path, lines: int = LINES) -> LogTail:
    """The last lines of a run's log; none if there is no log."""
    try:
        with open_file(folder / RUN_LOG) as file:
            size = os.fstat(file.fileno()).st_size
            start = file.seek(max(0, size - MOST_BYTES))
            found = file.read(MOST_BYTES).decode("utf-8", "replace").splitlines()
    except OSError:
        return LogTail()
    whole = found[1:] if start else found  # the first may be a part of one
    shown = whole[-lines:] if lines else []
    return LogTail([visible(line)[:LONGEST] for line in shown], size, bool(start) or len(shown) < len(whole))


def passages(lines: Sequence[str]) -> list[LogPassage]:
    """The lines of a log, its tracebacks apart."""
    found: list[tuple[bool, list[str]]] = []
    within = False
    for line in lines:
        within = line == TRACEBACK or (within and not ENTRY.match(line))
        if not found or found[-1][0] != within:
            found.append((within, []))
        found[-1][1].append(line)
    return [LogPassage("\n".join(text), is_traceback) for is_traceback, text in found]
