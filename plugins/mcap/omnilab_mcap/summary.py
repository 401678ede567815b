"""What an MCAP log says of itself at its end."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from io import BytesIO
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    ChunkIndex,
    Footer,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

from omnilab_mcap.chunks import HEAD, LARGEST_BYTES, UnreadableRecord, parsed

FOOTER_BYTES = HEAD.size + 20
END_BYTES = FOOTER_BYTES + len(MCAP0_MAGIC)
IN_SUMMARY = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.STATISTICS: Statistics,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex,
    Opcode.METADATA_INDEX: MetadataIndex,
    Opcode.SUMMARY_OFFSET: SummaryOffset,
}


@dataclass
class LogSummary:
    """The index, the counts, and the schemas and channels once more, by their numbers."""

    start: int  # where it starts, bytes
    statistics: Statistics | None = None
    chunks: dict[int, ChunkIndex] = field(default_factory=dict)  # by the offset of the chunk
    others: set[int] = field(default_factory=set)  # offsets of attachments and metadata
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)

    def agrees(self, chunks: dict[int, tuple[int, int]], others: set[int], messages: int) -> bool:
        """Whether it tells of what was found: chunks with their first and last log time, offsets, a count."""
        known = {offset: (index.message_start_time, index.message_end_time) for offset, index in self.chunks.items()}
        counted = self.statistics is None or self.statistics.message_count == messages
        return counted and others >= self.others and chunks.items() >= known.items()


def read_summary(file: BinaryIO, size: int) -> LogSummary | None:
    """The summary at the end of a file of `size` bytes; None if it is not whole."""
    file.seek(max(size - END_BYTES, 0))
    end = file.read(END_BYTES)
    if len(end) < END_BYTES or HEAD.unpack_from(end) != (Opcode.FOOTER, 20) or not end.endswith(MCAP0_MAGIC):
        return None
    footer = Footer.read(ReadDataStream(BytesIO(end[HEAD.size :])))
    start = footer.summary_start or size - END_BYTES
    length = size - END_BYTES - start
    if not 0 <= length <= LARGEST_BYTES:
        return None
    file.seek(start)
    data = file.read(length)
    if footer.summary_crc not in {0, zlib.crc32(end[: FOOTER_BYTES - 4], zlib.crc32(data))}:
        return None
    try:
        return _parsed(data, start)
    except UnreadableRecord:
        return None


def _parsed(data: bytes, start: int) -> LogSummary:
    summary, at = LogSummary(start), 0
    while at < len(data):
        opcode, length = HEAD.unpack_from(data, at) if at + HEAD.size <= len(data) else (0, 0)
        end = at + HEAD.size + length
        if opcode not in IN_SUMMARY or end > len(data):
            raise UnreadableRecord("its index")
        match record := parsed(IN_SUMMARY[Opcode(opcode)], data[at:end]):
            case Statistics():
                summary.statistics = record
            case ChunkIndex():
                summary.chunks[record.chunk_start_offset] = record
            case AttachmentIndex() | MetadataIndex():
                summary.others.add(record.offset)
            case Schema():
                summary.schemas[record.id] = record
            case Channel():
                summary.channels[record.id] = record
        at = end
    return summary
