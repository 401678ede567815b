"""Reading a Rerun recording of which no byte is trusted: the whole messages before and after each damage.

A recording is a header, messages with their kind and length, and a footer. It has no checksum but that of the footer, so
a message is whole if it unpacks to sound Arrow data under its own number: a changed value within them cannot be told.
"""

from __future__ import annotations

import re
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import pyarrow as pa

from omnilab.log_files import PLACE_BYTES, DamagedFile, Unreadable
from omnilab_rerun.protobuf import Field, fields

HEADER = (
    b"RRF2\x00\x29\x00\x00\x01\x02\x00\x00"  # what it is, the version of the format (0.41), packed by LZ4, protobuf
)
VERSION = slice(4, 8)
HEAD = struct.Struct("<QQ")  # kind and length of every message
FOOTER = struct.Struct("<QQI8sI")  # start, length and checksum of the table of contents, what this is, how many tables
END, STORE, ARROW, BLUEPRINT = range(4)  # kinds of messages
TUID = struct.Struct("<xQxQ")  # a number of a chunk: when it was made, ns, and a count, each a field of its own
LARGEST_BYTES = 1 << 30  # of a message, packed or not: what is held in memory
STARTS = re.compile(rb"[\x01-\x03]\0{7}.{4}\0{4}\n", re.DOTALL)  # of messages: each begins with its field 1
UNSOUND = (pa.ArrowException, ValueError, KeyError, TypeError, OSError, OverflowError, struct.error)


@dataclass(frozen=True)
class Message:
    """Where a whole message lies, the recording or blueprint that it is of, and when its first row was logged, ns since 1970."""

    start: int
    end: int
    kind: int
    store: bytes
    log_ns: int | None = None


@dataclass(frozen=True)
class Gap:
    """Bytes that are no whole message. `torn`: the recording is whole up to here, where it ends."""

    start: int
    end: int
    torn: bool = False


class DamagedRecording(DamagedFile):
    """A recording's whole messages and the gaps between them; the memory needed is that of one message.

    DataError if every byte would have to be read MOST_READS times.
    """

    def __init__(self, path: Path, file: BinaryIO, size: int) -> None:
        super().__init__(file, size, path, STARTS)
        self.path = path
        start = self._read(0, len(HEADER))
        older = HEADER[:4] + start[VERSION] + HEADER[8:]  # which the program reads too
        self.header = start if start == older and start[VERSION] <= HEADER[VERSION] else HEADER
        found = list(self._scan(start))
        stores = Counter(piece.store for piece in found if isinstance(piece, Message))
        # a recording that is named once, beside others, is a misspelling: who opens one puts something into it
        odd = {store for store, count in stores.items() if count == 1 and len(stores) > 1}
        self.messages = [piece for piece in found if isinstance(piece, Message) and piece.store not in odd]
        self.gaps = [
            piece if isinstance(piece, Gap) else Gap(piece.start, piece.end)
            for piece in found
            if isinstance(piece, Gap) or piece.store in odd
        ]

    def bytes_of(self, messages: list[Message]) -> Iterator[bytes]:
        """A recording of these messages, without a footer."""
        yield self.header
        for message in messages:
            self._file.seek(message.start)
            yield self._file.read(message.end - message.start)

    def _scan(self, start: bytes) -> Iterator[Message | Gap]:
        if start != self.header:
            yield Gap(0, len(start), torn=HEADER[:4].startswith(start[:4]) and len(start) < len(HEADER))
        at = len(start)
        while at < self._size:
            try:
                kind, end = self._extent(at)
                if kind == END and self._is_end(at, end):
                    return
                store, log_ns = sound(kind, self._read(at, end - at)[HEAD.size :])
                yield Message(at, end, kind, store, log_ns)
                at = end
            except Unreadable as error:
                self._left -= PLACE_BYTES
                after = self._after(at)
                yield Gap(at, after, torn=after == self._size and (error.torn or self._is_zero(self._last_byte(at))))
                at = after
        yield Gap(at, at, torn=True)

    def _extent(self, at: int) -> tuple[int, int]:
        """Kind and end of the message here, as far as its head can be believed."""
        head = self._read(at, HEAD.size)
        if len(head) < HEAD.size:
            raise Unreadable(torn=True)
        kind, length = HEAD.unpack(head)
        end: int = at + HEAD.size + length
        if kind > BLUEPRINT or length > LARGEST_BYTES:
            raise Unreadable
        if end > self._size:
            raise Unreadable(torn=True)
        return kind, end

    def _is_end(self, at: int, end: int) -> bool:
        """Whether the table of contents here, and nothing else, is followed by the footer."""
        footer = self._read(end, FOOTER.size + 1)
        if len(footer) < FOOTER.size and self._size - end < FOOTER.size:
            raise Unreadable(torn=True)
        if len(footer) != FOOTER.size:
            return False
        start, length, _, name, tables = FOOTER.unpack(footer)
        return bool(start == at + HEAD.size and start + length == end and name == b"RRF2FOOT" and tables == 1)

    def _follows(self, at: int, heads: int = 2) -> bool:
        """Whether so many messages can start here, one after the other, or the file ends."""
        if at == self._size or heads == 0:
            return True
        try:
            kind, end = self._extent(at)
        except Unreadable:
            return False
        return end + FOOTER.size == self._size if kind == END else self._follows(end, heads - 1)

    def _begins(self, at: int) -> bool:
        self._left -= PLACE_BYTES
        try:
            kind, end = self._extent(at)
            sound(kind, self._read(at, end - at)[HEAD.size :])
        except Unreadable:
            return False
        return True


def sound(kind: int, content: bytes) -> tuple[bytes, int | None]:
    """The store that a message is of, and when the first row in it was logged; Unreadable if it is not whole."""
    try:
        found = fields(content)
        if kind == ARROW:
            store = store_id(found[1])
            return store, _log_ns(_batch(found), found)
        if kind == STORE:
            return store_id(fields(found[2])[2]), None
        return store_id(found[1]), None
    except UNSOUND as error:
        raise Unreadable from error


def store_id(field: Field) -> bytes:
    """The id of a recording or blueprint: its kind, its name and the name of its application."""
    found = fields(field)
    if found[1] not in {1, 2}:
        raise ValueError("neither a recording nor a blueprint")
    str(found[2], "utf-8")
    str(fields(found[3])[1], "utf-8")
    return bytes(field)


def _batch(found: dict[int, Field]) -> pa.RecordBatch:
    """The rows of a message, whose memory is bounded by what it says of their size and LARGEST_BYTES."""
    packed, payload = found.get(2, 0), found[5]
    if packed == 2:
        size = int(found[3])
        if size > LARGEST_BYTES:
            raise ValueError("too large")
        payload = pa.Codec("lz4_raw").decompress(payload, decompressed_size=size)
    (batch,) = pa.ipc.open_stream(payload)
    batch.validate(full=True)
    return batch


def _log_ns(batch: pa.RecordBatch, found: dict[int, Field]) -> int | None:
    """When the first row was logged; KeyError or ValueError if names and number are not those of a chunk of the message."""
    if found.get(7, 0) not in {
        0,
        1,
    }:  # whether it is static: a lost last byte, and the first of the next message in its place
        raise ValueError("neither true nor false")
    about = batch.schema.metadata
    number = int(about[b"rerun:id"].removeprefix(b"chunk_"), 16)
    if 6 in found:
        time_ns, count = TUID.unpack(found[6])
        if number != time_ns << 64 | count:
            raise ValueError("another chunk")
    names = [str(about[b"rerun:entity_path"], "utf-8")]
    for column in batch.schema:
        described = column.metadata or {}
        again = described.get(b"rerun:component", described.get(b"rerun:index_name", column.name.encode()))
        if again.decode() != column.name:
            raise ValueError("a column of two names")
        names += [column.name, str(column.type)]  # which holds the names within it
    if not all(map(str.isprintable, names)):  # on a zero Rerun's reader in Python would end the process
        raise ValueError("a name that is none")
    if "log_time" not in batch.schema.names or not batch.num_rows:
        return None
    return int(batch.column("log_time").cast("int64")[0].as_py())
