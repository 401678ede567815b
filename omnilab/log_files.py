"""Reading a damaged log, and mending it where it lies: the original or the mended file is there at any instant, and no damaged byte is thrown away."""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import shutil
import stat
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import BinaryIO

from omnilab.atomic_files import PART, is_process, write_whole
from omnilab.errors import DataError

MOST_READS = 8  # of each byte: damage makes some be read again, and a hostile log would make all be
PLACE_BYTES = 4096  # of reading that a damage counts for, and a place that looks like a record
BLOCK_BYTES = 1 << 20
LONGEST_HEAD = 16  # bytes of a record
KINDS = {stat.S_ISLNK: "a link", stat.S_ISDIR: "a folder", stat.S_ISFIFO: "a pipe"}


class Unreadable(Exception):
    """Bytes are no whole record. `torn`: the file ends within it."""

    def __init__(self, what: str = "", torn: bool = False) -> None:
        super().__init__(what)
        self.torn = torn


class DamagedFile(ABC):
    """A file of records with a head each, of which no byte is trusted: where reading goes on behind a damage.

    DataError if every byte would have to be read MOST_READS times.
    """

    def __init__(self, file: BinaryIO, size: int, name: str | Path, starts: re.Pattern[bytes]) -> None:
        self._file, self._size, self._left = file, size, MOST_READS * size + 64 * BLOCK_BYTES
        self.name = name
        self._starts = starts  # of records at which reading can begin again

    @abstractmethod
    def _extent(self, at: int) -> tuple[int, int]:
        """Kind and end of the record here, as far as its head can be believed; Unreadable if it cannot."""

    @abstractmethod
    def _follows(self, at: int, heads: int = 2) -> bool:
        """Whether so many records can start here, one after the other, or the file ends."""

    @abstractmethod
    def _begins(self, at: int) -> bool:
        """Whether a whole record starts here, with next to no doubt."""

    def _read(self, at: int, length: int) -> bytes:
        if self._left < 0:
            raise DataError(f"{self.name} is damaged in too many places to be mended; it is as it was")
        self._file.seek(at)
        data = self._file.read(length)
        self._left -= len(data)
        return data

    def _after(self, at: int) -> int:
        """Where reading goes on after a record that cannot be read: behind it, or at the next that can be one."""
        end = self._last_byte(at) + 1
        # what looks like records within it is not proven by anything
        return end if end > at + 1 and self._follows(end) else self._next(at + 1)

    def _next(self, at: int) -> int:
        """The first whole record from here on, or the end of the file."""
        while at < self._size:
            block = self._read(at, BLOCK_BYTES + LONGEST_HEAD)
            for match in self._starts.finditer(block):
                if self._begins(at + match.start()):
                    return at + match.start()
            at += BLOCK_BYTES
        return self._size

    def _last_byte(self, at: int) -> int:
        """Where the last byte of the record here lies, or its first if it does not tell its length."""
        try:
            return self._extent(at)[1] - 1
        except Unreadable:
            return at

    def _is_zero(self, at: int) -> bool:
        """Whether the rest of the file is."""
        return all(not self._read(start, BLOCK_BYTES).strip(b"\0") for start in range(at, self._size, BLOCK_BYTES))


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
