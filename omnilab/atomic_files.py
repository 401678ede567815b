"""Files that are whole or not there, whoever else writes them, and whenever the writer is killed."""

from __future__ import annotations

import os
import secrets
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

PART = r"\.(?P<pid>\d{1,9})-[0-9a-f]{8}\.part"  # what follows the name of a file that is being written


def write_whole(file: Path, write: Callable[[BinaryIO], object]) -> int:
    """Write a file under a name of this process's own, then give it its own; its size in bytes.

    OSError names the file and leaves nothing behind, a kill a file whose name ends as `PART` says.
    """
    part = file.with_name(f"{file.name}.{os.getpid()}-{secrets.token_hex(4)}.part")
    try:
        with part.open("wb") as out:
            write(out)
        size = part.stat().st_size
        part.replace(file)
    except OSError as error:
        if error.filename in {None, str(part)}:
            error.filename = str(file)
        raise
    finally:
        part.unlink(missing_ok=True)
    return size


def is_process(pid: int) -> bool:
    """Whether there is a process of this number here, be it somebody else's."""
    if pid <= 0:  # to os.kill, a group of processes
        return False
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True
