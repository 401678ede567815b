"""Reading an MCAP log of which no byte is trusted: the whole records before and after each damage.

Chunks, attachments, the data section and the summary have checksums, of which 0 means that the writer computed none.
What no checksum covers is held against the rest of the log: lengths, counts, offsets, message indexes.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, DataEnd, Header, McapRecord, Message, MessageIndex, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

from omnilab.errors import DataError
from omnilab.log_files import PLACE_BYTES, DamagedFile
from omnilab_mcap.chunks import (
    HEAD,
    LARGEST_BYTES,
    Index,
    UnreadableRecord,
    is_chunk,
    message,
    opened,
    parsed,
    times,
    written,
)
from omnilab_mcap.summary import read_summary

IN_DATA = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.MESSAGE_INDEX: MessageIndex,
    Opcode.ATTACHMENT: Attachment,
    Opcode.METADATA: Metadata,
    Opcode.DATA_END: DataEnd,
}
PRIVATE = range(0x80, 0x100)  # opcodes that the format leaves to others
OPCODES = {*Opcode, *PRIVATE}
STARTS = re.compile(rb"[\x03-\x06\x09\x0c\x0f](?=.{4}\0{4})", re.DOTALL)  # of records at which reading can begin again
OUTSIDE_CHUNKS = {Opcode.CHUNK, Opcode.ATTACHMENT, Opcode.METADATA, Opcode.DATA_END}  # those of a log with chunks


@dataclass(frozen=True)
class Damage:
    """Bytes that are no whole record."""

    start: int
    end: int
    what: str
    torn: bool = False  # the log is whole up to here, where it ends
    messages: bool = False  # there may have been some


class DamagedLog(DamagedFile):
    """A log's records in the order of the file, chunks taken apart, and the damages between them.

    The memory needed is that of a few records. DataError for a record larger than LARGEST_BYTES, and for a log of which
    every byte would have to be read MOST_READS times.
    """

    def __init__(self, file: BinaryIO, size: int) -> None:
        super().__init__(file, size, file.name, STARTS)
        self.summary = read_summary(file, size)
        self._channels = set(self.summary.channels) if self.summary else set[int]()
        self._chunked = bool(self.summary and self.summary.chunks)

    def __iter__(self) -> Iterator[McapRecord | Damage]:
        start = self._read(0, len(MCAP0_MAGIC))
        if start != MCAP0_MAGIC:
            yield Damage(0, len(start), "its first bytes", torn=MCAP0_MAGIC.startswith(start))
        at, crc, sound = len(start), zlib.crc32(start), start == MCAP0_MAGIC
        chunks, others, messages = dict[int, tuple[int, int]](), set[int](), 0
        self._index: Index = {}  # what the message indexes behind the last chunk should hold
        while at < self._size:
            try:
                opcode, end, raw = self._record(at)
                records = self._parsed(opcode, raw, at)
                if opcode == Opcode.MESSAGE_INDEX and sound and not agrees(records[0], self._index):
                    raise UnreadableRecord("the index of a chunk", messages=False)
            except UnreadableRecord as error:
                self._left -= PLACE_BYTES
                after = self._after(at)
                torn = after == self._size and (error.torn or self._is_zero(self._last_byte(at)))
                yield Damage(at, after, str(error), torn, error.messages or after != self._last_byte(at) + 1)
                at, sound = after, False
                continue
            crc_before, crc, at = crc, zlib.crc32(raw, crc), end
            if opcode == Opcode.DATA_END:
                if sound and records[0].data_section_crc not in {0, crc_before}:
                    yield Damage(0, at, "something outside its chunks, which the checksum of the whole tells")
                elif sound and self.summary and not self.summary.agrees(chunks, others, messages):
                    yield Damage(at, self._size, "its index, which disagrees with its content")
                elif self.summary is None or self.summary.start != at:
                    yield Damage(at, self._size, "its index", torn=self._ends_early(at))
                return
            if opcode == Opcode.CHUNK:
                chunks[end - len(raw)] = times(raw)
            elif opcode in {Opcode.ATTACHMENT, Opcode.METADATA}:
                others.add(end - len(raw))
            for record in records:
                messages += isinstance(record, Message)
                if isinstance(record, Channel):
                    self._channels.add(record.id)
                yield record
        if sound:  # a damage goes to the end
            yield Damage(at, at, "its end", torn=True)

    def _extent(self, at: int) -> tuple[int, int]:
        """Opcode and end of the record here, as far as its head can be believed."""
        head = self._read(at, HEAD.size)
        if len(head) < HEAD.size:
            raise UnreadableRecord("its end", torn=True)
        opcode, length = HEAD.unpack(head)
        if opcode not in OPCODES:
            raise UnreadableRecord(f"a record of the unknown kind {opcode}")
        end = at + HEAD.size + length
        if end > self._size:
            known = opcode not in PRIVATE and length <= LARGEST_BYTES
            raise UnreadableRecord("a record that goes beyond the end", torn=known)
        return opcode, end

    def _follows(self, at: int, heads: int = 2) -> bool:
        """Whether so many records of the format's own kinds can start here, one after the other, or the file ends."""
        if at == self._size or heads == 0:
            return True
        try:
            opcode, end = self._extent(at)
        except UnreadableRecord:
            return False
        return opcode not in PRIVATE and self._follows(end, heads - 1)

    def _record(self, at: int) -> tuple[int, int, bytes]:
        """Opcode, end and bytes of the record here."""
        opcode, end = self._extent(at)
        if end - at > LARGEST_BYTES:
            if self._follows(end):
                raise DataError(
                    f"{self._file.name} has a record of {end - at} bytes, and up to {LARGEST_BYTES} are held in memory; it"
                    " cannot be checked here and is as it was"
                )
            raise UnreadableRecord("a record that is too large")
        return opcode, end, self._read(at, end - at)

    def _parsed(self, opcode: int, raw: bytes, at: int) -> list[McapRecord]:
        """What a record of the data section holds; UnreadableRecord if it is not whole."""
        if opcode != Opcode.CHUNK and is_chunk(raw[:64], len(raw)):  # one damaged byte makes it anything else
            raise UnreadableRecord(f"a chunk that calls itself a record of kind {opcode}")
        if opcode in PRIVATE:
            if not self._follows(at + len(raw)):
                raise UnreadableRecord(f"a record of the unknown kind {opcode}")
            return []
        if opcode == Opcode.CHUNK:
            self._chunked = True
            records, self._index = opened(raw, self._file.name)
            return records
        if opcode == Opcode.MESSAGE:
            if self._is_index(raw):  # one flipped bit of its opcode makes it a message
                raise UnreadableRecord("the index of a chunk", messages=False)
            return [message(raw)]
        if opcode not in IN_DATA or (opcode == Opcode.HEADER) != (at == len(MCAP0_MAGIC)):
            raise UnreadableRecord("a record that does not belong there")
        record = parsed(IN_DATA[Opcode(opcode)], raw)
        if len(raw) > len(written(record)) and not self._follows(at + len(raw)):
            raise UnreadableRecord("a record of another length than its content has", messages=False)
        return [record]

    def _is_index(self, raw: bytes) -> bool:
        """Whether these bytes are a message index of the last chunk, whatever their opcode says."""
        try:
            found = parsed(MessageIndex, raw)
        except UnreadableRecord:
            return False
        return isinstance(found, MessageIndex) and bool(found.records) and agrees(found, self._index)

    def _begins(self, at: int) -> bool:
        """Whether a whole record starts here, with next to no doubt."""
        self._left -= PLACE_BYTES
        try:
            opcode, end = self._extent(at)
            if (self._chunked and opcode not in OUTSIDE_CHUNKS) or not self._follows(end):
                return False
            if opcode == Opcode.CHUNK:
                return is_chunk(self._read(at, 64), end - at)
            if end - at > LARGEST_BYTES:
                return False
            (record,) = self._parsed(opcode, self._read(at, end - at), at)
        except (UnreadableRecord, ValueError):
            return False
        return not isinstance(record, Message) or record.channel_id in self._channels

    def _ends_early(self, at: int) -> bool:
        """Whether the summary that starts here is whole as far as it goes, or zeros."""
        opcode = None
        while at < self._size and opcode != Opcode.FOOTER:
            try:
                opcode, at = self._extent(at)
            except UnreadableRecord as error:
                return error.torn or self._is_zero(at)
        rest = self._read(at, len(MCAP0_MAGIC) + 1)
        return rest != MCAP0_MAGIC and (MCAP0_MAGIC.startswith(rest) or self._is_zero(at))


def agrees(found: MessageIndex, index: Index) -> bool:
    """Whether a message index tells where the messages of its channel are."""
    return sorted(found.records) == sorted(index.get(found.channel_id, []))
