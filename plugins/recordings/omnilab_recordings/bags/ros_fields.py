"""The bytes of ROS messages, field by field: the serialisation of ROS 1, and CDR (OMG, XCDR1), which ROS 2 has.

Only types that are known here are read, by their own definitions: what a log says that its types are is not compiled.
"""

from __future__ import annotations

import struct

import numpy as np

from omnilab.api import Floats
from omnilab.errors import DataError

PLAIN_CDR = {0: ">", 1: "<"}  # by the second byte of the encapsulation


class RosFields:
    """A reader that goes through a message; DataError where it ends too early."""

    def __init__(self, data: memoryview, encoding: str) -> None:
        self.is_cdr = encoding == "cdr"
        self._data, self._order, self._start = data, "<", 0
        if self.is_cdr:
            if len(data) < 4 or data[0] != 0 or data[1] not in PLAIN_CDR:
                raise DataError("is in a form of CDR that is not read")
            self._order, self._start = PLAIN_CDR[data[1]], 4
        self._at = self._start

    def number(self, code: str) -> int | float:
        """One number, by its code of `struct`."""
        size = struct.calcsize(code)
        self._align(size)
        raw = self._take(size)
        value: int | float = struct.unpack(self._order + code, raw)[0]
        return value

    def whole(self, code: str = "I") -> int:
        """One whole number, unsigned of 32 bits by default."""
        return int(self.number(code))

    def doubles(self, count: int | None = None) -> Floats:
        """Numbers of 64 bits: so many, or as many as the message says before them."""
        if count is None:
            count = self.whole()
        if count:
            self._align(8)
        return np.frombuffer(self._take(8 * count), self._order + "f8").astype(float)

    def text(self) -> str:
        """A text behind its length."""
        raw = bytes(self._take(self.whole()))
        return raw.rstrip(b"\0").decode("utf-8", "replace")

    def data(self) -> memoryview:
        """Bytes behind their number."""
        return self._take(self.whole())

    def header(self) -> tuple[int, str]:
        """std_msgs/Header: the time in nanoseconds, and the frame."""
        if not self.is_cdr:
            self.whole()  # a sequence number
        seconds = self.whole("i" if self.is_cdr else "I")
        return seconds * 10**9 + self.whole(), self.text()

    def _align(self, size: int) -> None:
        if self.is_cdr:
            self._at += -(self._at - self._start) % size

    def _take(self, size: int) -> memoryview:
        taken = self._data[self._at : self._at + size]
        if len(taken) < size:
            raise DataError("is cut short")
        self._at += size
        return taken
