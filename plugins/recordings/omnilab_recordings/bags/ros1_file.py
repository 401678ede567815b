"""Bags of ROS 1 (format 2.0), read from front to back: also those without an index, or cut off.

The format is that of https://wiki.ros.org/Bags/Format/2.0: records of a header (fields name=value) and data; chunks hold
connections and messages.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from pathlib import Path

from omnilab_recordings.bags.message import BinaryFile, Damaged, LogMessage, Place
from omnilab_recordings.bags.unpacking import unpacked

MAGIC = b"#ROSBAG V2.0\n"
MESSAGE, CHUNK, CONNECTION = 2, 5, 7  # the values of `op`
U32 = struct.Struct("<I")
Header = dict[bytes, bytes]


class Ros1File(BinaryFile):
    """A bag. A place is (start of the chunk's data, start of the message's, their length), or (-1, ...) outside chunks."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._topics: dict[bytes, tuple[str, str]] = {}
        self._chunks: dict[int, tuple[int, str, int]] = {}  # by their data's start: length, codec, length unpacked

    def messages(self) -> Iterator[LogMessage]:
        """Every message, in the file's order."""
        try:
            self._file.seek(0)
            if self._file.readline(64) != MAGIC:
                raise Damaged("no bag of ROS 1 in format 2.0 (rosbag migrate updates older ones)")
            while head := self._file.read(4):
                yield from self._record(head)
        except Damaged as damaged:
            self.damage = str(damaged)

    def _record(self, head: bytes) -> Iterator[LogMessage]:
        """The messages of the record that begins with these four bytes."""
        header = _fields(self._exactly(_number(head)))
        size, start = _number(self._exactly(4)), self._file.tell()
        if (op := _op(header)) == CHUNK:
            self._chunks[start] = (size, header.get(b"compression", b"").decode("ascii", "replace"), _size_of(header))
            try:
                yield from self._of_chunk(start)
            except Damaged as damaged:  # what lies behind it may be whole
                self._check_whole(start + size)
                self.damage = str(damaged)
        elif op == CONNECTION:
            self._note(header, self._exactly(size))
        elif op == MESSAGE:
            yield self._message(header, memoryview(self._exactly(size)), (-1, start, size))
        self._file.seek(start + size)

    def _of_chunk(self, start: int) -> Iterator[LogMessage]:
        content = self._chunk(start)
        at = 0
        while at < len(content):
            header_at = at + 4
            header_size = _number(content[at:header_at])
            data_at = header_at + header_size + 4
            header, size = _fields(content[header_at : data_at - 4]), _number(content[data_at - 4 : data_at])
            at = data_at + size
            if at > len(content):
                raise Damaged("a chunk whose messages are cut off")
            if (op := _op(header)) == CONNECTION:
                self._note(header, content[data_at:at])
            elif op == MESSAGE:
                yield self._message(header, content[data_at:at], (start, data_at, size))

    def _message(self, header: Header, data: memoryview, place: Place) -> LogMessage:
        topic, kind = self._topics.get(header.get(b"conn", b""), ("", ""))
        time = header.get(b"time", b"")
        if len(time) != 8:
            raise Damaged("a message without a time")
        seconds, nanoseconds = struct.unpack("<II", time)
        return LogMessage(topic, kind, "ros1", seconds * 10**9 + nanoseconds, data, place)

    def _note(self, header: Header, data: bytes | memoryview) -> None:
        """Topic and type of a connection."""
        kind = _fields(data).get(b"type", b"").decode("utf-8", "replace")
        self._topics[header.get(b"conn", b"")] = header.get(b"topic", b"").decode("utf-8", "replace"), kind

    def _read_chunk(self, start: int) -> memoryview:
        length, packed_by, size = self._chunks[start]
        self._file.seek(start)
        return unpacked(memoryview(self._exactly(length)), packed_by, size)


def _fields(data: bytes | memoryview) -> Header:
    fields, stream = {}, io.BytesIO(data)
    while length := stream.read(4):
        name, equals, value = stream.read(_number(length)).partition(b"=")
        if not equals:
            raise Damaged("a record whose header is broken")
        fields[name] = value
    return fields


def _number(data: bytes | memoryview) -> int:
    if len(data) != 4:
        raise Damaged("the end is cut off")
    return int(U32.unpack(data)[0])


def _op(header: Header) -> int:
    op = header.get(b"op", b"")
    if len(op) != 1:
        raise Damaged("a record whose header is broken")
    return op[0]


def _size_of(header: Header) -> int:
    return _number(header.get(b"size", b""))
