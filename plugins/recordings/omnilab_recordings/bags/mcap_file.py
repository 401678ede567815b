"""MCAP logs, read from front to back: also those without an index, or cut off.

The format is that of https://mcap.dev/spec: records of an opcode, a length and content; chunks hold schemas, channels and
messages.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

from omnilab_recordings.bags.message import BinaryFile, Damaged, LogMessage
from omnilab_recordings.bags.unpacking import unpacked

MAGIC = b"\x89MCAP0\r\n"
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, ATTACHMENT, DATA_END = 0x02, 0x03, 0x04, 0x05, 0x06, 0x09, 0x0F
HEAD = struct.Struct("<BQ")
IN_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence number, log time, publish time
IN_CHUNK = struct.Struct("<QQQI")  # first and last log time, size and checksum of what it unpacks to
LARGEST_ATTACHMENT = 2**24  # bytes


class McapFile(BinaryFile):
    """A log. A place is (start of the chunk's record, start of the message's data, its length), or (-1, ...) outside chunks."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, tuple[str, str, str]] = {}  # topic, kind, encoding
        self._attachments: dict[str, bytes] = {}

    def messages(self) -> Iterator[LogMessage]:
        """Every message, in the file's order."""
        try:
            self._file.seek(0)
            if self._file.read(len(MAGIC)) != MAGIC:
                raise Damaged("no MCAP log")
            while True:
                at = self._file.tell()
                opcode, length = HEAD.unpack(self._exactly(HEAD.size))
                if opcode in {DATA_END, FOOTER}:
                    return
                self._check_whole(at + HEAD.size + length)
                self._file.seek(at + HEAD.size)
                yield from self._record(opcode, length, at)
                self._file.seek(at + HEAD.size + length)
        except Damaged as damaged:
            self.damage = str(damaged)

    def _record(self, opcode: int, length: int, at: int) -> Iterator[LogMessage]:
        if opcode == CHUNK:
            try:
                yield from self._of_chunk(at)
            except Damaged as damaged:  # what lies behind it may be whole
                self.damage = str(damaged)
        elif opcode in {SCHEMA, CHANNEL, MESSAGE}:
            content = memoryview(self._exactly(length))
            yield from self._in_content(opcode, content, (-1, at + HEAD.size))
        elif opcode == ATTACHMENT and length < LARGEST_ATTACHMENT:
            self._attach(self._exactly(length))

    def _of_chunk(self, at: int) -> Iterator[LogMessage]:
        content, start = self._chunk(at), 0
        while start + HEAD.size <= len(content):
            opcode, length = HEAD.unpack_from(content, start)
            start += HEAD.size
            if start + length > len(content):
                raise Damaged("a chunk whose messages are cut off")
            yield from self._in_content(opcode, content[start : start + length], (at, start))
            start += length

    def _in_content(self, opcode: int, content: memoryview, place: tuple[int, int]) -> Iterator[LogMessage]:
        """The message that a record is; schemas and channels are noted."""
        try:
            if opcode == SCHEMA:
                name, _ = _text(content, 2)
                self._schemas[_u16(content, 0)] = name
            elif opcode == CHANNEL:
                topic, at = _text(content, 4)
                self._channels[_u16(content, 0)] = topic, self._schemas.get(_u16(content, 2), ""), _text(content, at)[0]
            elif opcode == MESSAGE:
                channel, _, log_ns, _ = IN_MESSAGE.unpack_from(content)
                topic, kind, encoding = self._channels.get(channel, ("", "", ""))
                data = content[IN_MESSAGE.size :]
                yield LogMessage(topic, kind, encoding, log_ns, data, (place[0], place[1] + IN_MESSAGE.size, len(data)))
        except struct.error as error:
            raise Damaged("a record that is cut short") from error

    def _attach(self, content: bytes) -> None:
        try:
            name, at = _text(memoryview(content), 16)
            _, at = _text(memoryview(content), at)
            (size,) = struct.unpack_from("<Q", content, at)
        except struct.error as error:
            raise Damaged("an attachment that is cut short") from error
        self._attachments[name] = content[at + 8 : at + 8 + size]

    def _read_chunk(self, at: int) -> memoryview:
        self._file.seek(at)
        _, length = HEAD.unpack(self._exactly(HEAD.size))
        record = memoryview(self._exactly(length))
        try:
            _, _, size, crc = IN_CHUNK.unpack_from(record)
            packed_by, start = _text(record, IN_CHUNK.size)
            (packed,) = struct.unpack_from("<Q", record, start)
        except struct.error as error:
            raise Damaged("a chunk that is cut short") from error
        content = unpacked(record[start + 8 : start + 8 + packed], packed_by, size)
        if crc not in {0, zlib.crc32(content)}:
            raise Damaged("a chunk that fails its checksum")
        return content

    def attachments(self) -> dict[str, bytes]:
        """Small files that travel with the log, by name."""
        return self._attachments


def _u16(data: memoryview, at: int) -> int:
    return int(struct.unpack_from("<H", data, at)[0])


def _text(data: memoryview, at: int) -> tuple[str, int]:
    """A text behind its length, and where it ends."""
    (length,) = struct.unpack_from("<I", data, at)
    if at + 4 + length > len(data):
        raise Damaged("a record that is cut short")
    return bytes(data[at + 4 : at + 4 + length]).decode("utf-8", "replace"), at + 4 + length
