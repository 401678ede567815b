"""Repair of the MCAP log of a run that was killed."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO

import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC, Writer

from omnilab.errors import DataError

FOOTER_START = b"\x02" + struct.pack("<Q", 20)  # opcode and length
FOOTER_BYTES = 9 + 20
TORN = (McapError, struct.error, ValueError, OverflowError, MemoryError, zstandard.ZstdError)
LARGEST_CHUNK_BYTES = 1 << 30


def repair(path: Path) -> str | None:
    """Rewrite a log that has no footer with all its whole chunks and an index; None if it is whole or absent."""
    if not path.exists() or is_whole(path):
        return None
    mended = path.with_suffix(".mcap.part")
    try:
        with path.open("rb") as source, mended.open("wb") as target:
            kept = copy(whole_records(source, path.stat().st_size), Writer(target))
        mended.replace(path)
    finally:
        mended.unlink(missing_ok=True)
    return f"{path.name} was torn: {kept} messages were kept and indexed again"


def is_whole(path: Path) -> bool:
    """Whether the log ends with a footer; DataError if the file does not start as an MCAP log does."""
    with path.open("rb") as file:
        start = file.read(len(MCAP0_MAGIC))
        if not MCAP0_MAGIC.startswith(start):
            raise DataError(f"{path} is not an MCAP log (it starts with {start!r}); move it away")
        file.seek(-min(path.stat().st_size, FOOTER_BYTES + len(MCAP0_MAGIC)), 2)
        end = file.read()
    return end.startswith(FOOTER_START) and end.endswith(MCAP0_MAGIC)


def whole_records(file: BinaryIO, size: int) -> Iterator[McapRecord]:
    """All records up to the first that is torn, chunks taken apart."""
    try:
        for record in StreamReader(file, emit_chunks=True, record_size_limit=size).records:
            if isinstance(record, Chunk):
                yield from opened(record)
            else:
                yield record
    except TORN:
        return


def opened(chunk: Chunk) -> Iterator[McapRecord]:
    """A chunk's records, checked against its checksum."""
    if chunk.uncompressed_size > LARGEST_CHUNK_BYTES:
        raise McapError(f"a chunk of {chunk.uncompressed_size} bytes")
    if chunk.compression == "zstd" and zstandard.frame_content_size(chunk.data) != chunk.uncompressed_size:
        raise McapError("a chunk that unpacks to another size than it says")
    yield from breakup_chunk(chunk, validate_crc=True)


def copy(records: Iterable[McapRecord], writer: Writer) -> int:
    """Write records into a new log with an index; the number of messages."""
    schemas, channels, messages = {0: 0}, dict[int, int](), 0
    writer.start()
    for record in records:
        match record:
            case Schema() if record.id not in schemas:
                schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
            case Channel() if record.id not in channels:
                channels[record.id] = writer.register_channel(
                    record.topic, record.message_encoding, schemas[record.schema_id], record.metadata
                )
            case Metadata():
                writer.add_metadata(record.name, record.metadata)
            case Message():
                channel = channels[record.channel_id]
                writer.add_message(channel, record.log_time, record.data, record.publish_time, record.sequence)
                messages += 1
    writer.finish()
    return messages
