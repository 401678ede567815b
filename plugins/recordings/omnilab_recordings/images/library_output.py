"""What image libraries write to standard error while they decode: heard, and kept off the user's terminal."""

from __future__ import annotations

import os
import re
import tempfile
import threading
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")

LIBRARIES = re.compile(
    rb"jpeg|png|tiff|webp|opencv|\[ ?(WARN|ERROR|INFO|DEBUG|FATAL):|marker|Huffman|JFIF|SOS|Adobe|progression|scanline"
    rb"|^(>|\s|must be )",  # lines that go on
    re.IGNORECASE,
)
MOST_TEXT = 2**16  # bytes that are looked at


class LibraryOutput:
    """Takes standard error, file descriptor 2, for as long as any thread decodes; any number may at a time.

    Libraries written in C write there and tell nobody else. What other threads of ours write meanwhile is passed on.
    """

    def __init__(self) -> None:
        self._turn = threading.Condition()
        self._users, self._alone = 0, False
        self._heard = self._terminal = -1  # a file that stands in for standard error, and where that leads

    def of(self, call: Callable[[], T], alone: bool = False) -> tuple[T, str]:
        """The result of a call, and what libraries wrote meanwhile: of a second call, alone, where others may have."""
        result, text = self._call(call, alone)
        return self._call(call, alone=True) if text and not alone else (result, text)

    def _call(self, call: Callable[[], T], alone: bool) -> tuple[T, str]:
        with self._turn:
            self._turn.wait_for(lambda: not self._alone and not (alone and self._users))
            self._alone, self._users = alone, self._users + 1
            if self._users == 1:
                self._take()
            start = self._length()
        try:
            result = call()
            return result, "\n".join(
                line.decode("ascii", "replace") for line in self._lines(start) if LIBRARIES.search(line)
            )
        finally:
            with self._turn:
                self._alone, self._users = False, self._users - 1
                if self._users == 0:
                    self._give_back()
                self._turn.notify_all()

    def _take(self) -> None:
        try:
            self._terminal = os.dup(2)
        except OSError:  # there is none
            return
        if self._heard < 0:
            with tempfile.TemporaryFile() as file:
                self._heard = os.dup(file.fileno())
        os.dup2(self._heard, 2)

    def _give_back(self) -> None:
        if self._terminal < 0:
            return
        os.dup2(self._terminal, 2)
        for line in self._lines(0):
            if line and not LIBRARIES.search(line):
                os.write(self._terminal, line + b"\n")
        os.ftruncate(self._heard, 0)
        os.lseek(self._heard, 0, os.SEEK_SET)
        os.close(self._terminal)
        self._terminal = -1

    def _length(self) -> int:
        return os.fstat(self._heard).st_size if self._terminal >= 0 else 0

    def _lines(self, start: int) -> list[bytes]:
        return os.pread(self._heard, MOST_TEXT, start).splitlines() if self._terminal >= 0 else []


LIBRARY_OUTPUT = LibraryOutput()
