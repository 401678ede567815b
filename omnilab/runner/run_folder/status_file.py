"""How a run stands, and room on the disk to say so at the end."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO

from omnilab.runner.run_folder.names import RESERVED, STATUS
from omnilab.runner.run_folder.tables import write_text

ROOM, LEAST = 1 << 16, 1 << 14  # bytes: until the results are written, and from then on
LONGEST = 500  # characters of each text, where they would not fit otherwise


def reserve(folder: Path) -> BinaryIO:
    """Set room aside for the last status of a run; OSError if there is none.

    It can be written whatever else fills the disk, but on file systems that write every block anew (ZFS, Btrfs with
    snapshots), where it is likely; and it is open, should there be too many open files by then.
    """
    out = (folder / RESERVED).open("w+b")
    try:
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(out.fileno(), 0, ROOM)
        else:
            out.write(bytes(ROOM))
    except OSError:
        out.close()
        raise
    return out


def release(reserved: BinaryIO) -> None:
    """Leave most of the room to the results, of which the metrics are the first."""
    with suppress(OSError):  # they may find room without it
        reserved.truncate(LEAST)


def write_status(folder: Path, status: str, reserved: BinaryIO | None = None, **more: Any) -> None:
    """Say how the run stands: running, done, failed (with the error) or interrupted. OSError if that is impossible."""
    now = datetime.now(UTC).isoformat(timespec="seconds")
    content = {"status": status, "time": now, "pid": os.getpid(), **more}
    text = json.dumps(content, indent=2) + "\n"
    if len(text) > LEAST:
        text = json.dumps(_shortened(content), indent=2) + "\n"
    try:
        with reserved or (folder / RESERVED).open("r+b") as out:  # a run that was killed has left it
            out.seek(0)
            out.write(text.encode())
            out.truncate()
        (folder / RESERVED).replace(folder / STATUS)  # a reader never sees half a status
    except OSError:  # never set aside, or not to be overwritten where it is
        (folder / RESERVED).unlink(missing_ok=True)
        write_text(folder / STATUS, text)


def _shortened(content: Any) -> Any:
    """The same with the beginnings of its texts."""
    if isinstance(content, Mapping):
        return {key: _shortened(value) for key, value in content.items()}
    return f"{content[:LONGEST]} ..." if isinstance(content, str) and len(content) > LONGEST else content
