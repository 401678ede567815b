"""Standard output and error that may go away: a pager that is left, a disk that is full, a terminal that is closed.

Nothing but the standard library is imported here.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO, cast


class LastingStream:
    """A text stream that raises nothing: once it cannot be written, `error` says why, and what follows goes nowhere.

    Or it is printed on `instead`, with what was lost before; but not if a reader has seen enough.
    """

    def __init__(self, stream: TextIO, instead: LastingStream | None = None) -> None:
        self.error: Exception | None = None
        self._stream, self._instead = stream, instead
        self._waiting: list[str] = []  # what may not be written yet
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")

    def write(self, text: str) -> int:
        if self._instead is not None:
            self._waiting.append(text)
        if self.error is None:
            try:
                self._stream.write(text)
            except (OSError, ValueError) as error:  # ValueError: it was closed
                self._give_up(error)
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        for line in lines:
            self.write(line)

    def flush(self) -> None:
        try:
            self._stream.flush()
        except (OSError, ValueError) as error:
            self._give_up(error)
        if self._instead is not None and self.error is not None and not isinstance(self.error, BrokenPipeError):
            self._instead.writelines(self._waiting)
        self._waiting.clear()

    def _give_up(self, error: Exception) -> None:
        self.error = self.error or error
        with suppress(OSError):  # no file can be opened: then every write fails, and is caught above
            nowhere = os.open(os.devnull, os.O_WRONLY)  # for C libraries, too, and what Python flushes at its end
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)

    def __getattr__(self, name: str) -> object:
        return getattr(self._stream, name)


def outlast() -> None:
    """Make the standard streams of this process lasting ones; those that were closed are opened to nowhere.

    Otherwise the next file that is opened would get the number of standard error, and be written what C libraries say.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest number that is free
    if sys.stdout is None:
        sys.stdout = open(1, "w", encoding="utf-8")  # noqa: SIM115
    if sys.stderr is None:
        sys.stderr = open(2, "w", encoding="utf-8")  # noqa: SIM115
    errors = LastingStream(sys.stderr)
    sys.stderr = cast("TextIO", errors)
    sys.stdout = cast("TextIO", LastingStream(sys.stdout, errors))


def unwritten() -> str:
    """Why standard output could not be written; "" if it was, or its reader had seen enough."""
    sys.stdout.flush()
    error = getattr(sys.stdout, "error", None)
    if error is None or isinstance(error, BrokenPipeError):
        return ""
    return str(getattr(error, "strerror", None) or error)


@contextmanager
def printed_into(file: Path) -> Iterator[None]:
    """Within it all that this process prints, C libraries too, goes to the end of a file; nowhere if there can be none."""
    _flush()
    before = [os.dup(number) for number in (1, 2)]
    target = _appended(file)
    for number in (1, 2):
        os.dup2(target, number)
    try:
        yield
    finally:
        _flush()
        empty = os.fstat(target).st_size == 0
        for number, own in zip((1, 2), before, strict=True):
            os.dup2(own, number)
            os.close(own)
        os.close(target)
        if empty:
            with suppress(OSError):
                file.unlink()


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        stream.flush()


def _appended(file: Path) -> int:
    """A descriptor that writes to the end of a file, or to nowhere."""
    try:
        file.parent.mkdir(exist_ok=True)
        return os.open(file, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW, 0o666)
    except OSError:
        return os.open(os.devnull, os.O_WRONLY)
