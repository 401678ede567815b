"""Mending a log where it lies: the original or the mended file is there at any instant, and no damaged byte is thrown away."""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import shutil
import stat
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import BinaryIO

from omnilab.atomic_files import PART, is_process, write_whole
from omnilab.errors import DataError

KINDS = {stat.S_ISLNK: "a link", stat.S_ISDIR: "a folder", stat.S_ISFIFO: "a pipe"}


def is_there(log: Path) -> bool:
    """Whether there is a log to look at; DataError if something else has its name, which is not looked into."""
    try:
        mode = log.lstat().st_mode
    except FileNotFoundError:
        return False
    if not stat.S_ISREG(mode):
        kind = next((name for is_kind, name in KINDS.items() if is_kind(mode)), "a device")
        raise DataError(f"{log} is {kind}, and logs are files: it is left as it is; put the log itself in its place")
    return True


def replace_mended(log: Path, write: Callable[[BinaryIO], object], keep: bool) -> Path | None:
    """Write a log anew in its own place; where the damaged one lies now, if it is to be kept beside.

    DataError if the disk does not allow it: then everything is as it was.
    """
    before = log.stat()

    def write_through(out: BinaryIO) -> None:
        write(out)
        out.flush()
        os.fsync(out.fileno())  # the original goes
        with contextlib.suppress(PermissionError):  # somebody else's file in one's own folder
            os.fchown(out.fileno(), before.st_uid, before.st_gid)
        os.fchmod(out.fileno(), stat.S_IMODE(before.st_mode))

    aside: Path | None = None
    try:
        _remove_parts(log)
        if keep:
            aside = _second_name(log)
        write_whole(log, write_through)
    except BaseException as error:
        if aside is not None:
            aside.unlink()
        if not isinstance(error, OSError):
            raise
        raise unmended(log, error.strerror) from error
    return aside


def unmended(log: Path, why: str | None) -> DataError:
    """The sentence about a log that could not be written anew."""
    return DataError(
        f"{log} cannot be mended in its place ({why}) and is as it was; for a mended copy elsewhere:"
        f" omnilab repair {log.parent} --output DIR"
    )


def _second_name(log: Path) -> Path:
    """The first of `run.mcap.damaged`, `run.mcap.damaged-2`, ... that is free, now the file's too."""
    for number in itertools.count(1):
        aside = log.with_name(f"{log.name}.damaged" + (f"-{number}" if number > 1 else ""))
        try:
            aside.hardlink_to(log)
        except FileExistsError:
            if aside.is_symlink() or not aside.samefile(log):  # else a repair was killed that had come so far
                continue
        except OSError:  # a disk without hard links
            if aside.exists():
                continue
            with log.open("rb") as damaged:
                write_whole(aside, partial(shutil.copyfileobj, damaged))
        return aside
    raise AssertionError("unreachable")


def _remove_parts(log: Path) -> None:
    """Remove what repairs that were killed had begun."""
    for file in log.parent.glob(f"{log.name}.*.part"):
        name = re.fullmatch(re.escape(log.name) + PART, file.name)
        if name and not is_process(int(name["pid"])):
            file.unlink()
