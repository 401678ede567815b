"""An MCAP writer whose records are with the operating system as soon as they are added."""

from __future__ import annotations

import os
import struct
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from mcap.writer import Writer

from omnilab_mcap.chunks import MESSAGE_BYTES, written

SKIPPED = 0x80  # opcode of a record of our own, which readers skip
HEAD_BYTES = 9  # of every record: opcode and length
MESSAGE = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence number, both times


class TailedFile:
    """Whole chunks, and behind them, as its tail, the records of the next one, each for itself.

    A chunk is written over its own records when it is complete, in one go. So nothing waits in memory for a thread to
    write it, which none can while a library holds Python's lock, and the finished file is as any other.
    """

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY | os.O_CLOEXEC, 0o666)
        self._whole = self._tail = 0  # bytes in the file
        self._completed = bytearray()  # what the writer has written, not yet in the file

    def write(self, data: bytes) -> int:
        """Of the writer: chunks, and the start and end of the file."""
        self._completed += data
        return len(data)

    def tell(self) -> int:
        """Of the writer: where its next bytes will be."""
        return self._whole + len(self._completed)

    def flush(self) -> None:
        """Put what the writer has completed in the tail's place; OSError without room, and the tail remains."""
        if not self._completed:
            return
        data, tail = bytes(self._completed), self._tail
        if (left := tail - len(data)) >= HEAD_BYTES:  # of the tail, for those who read before it is cut off
            data += bytes([SKIPPED]) + (left - HEAD_BYTES).to_bytes(8, "little")
        self._put(data[tail:], self._whole + tail)  # first what needs room
        self._put(data[:tail], self._whole)
        self._whole, self._tail = self.tell(), 0
        self._completed.clear()
        os.ftruncate(self._file, self._whole)

    def append(self, record: bytes) -> None:
        """A record of the next chunk, head included."""
        self._put(record, self._whole + self._tail)
        self._tail += len(record)

    def close(self) -> None:
        os.close(self._file)

    def _put(self, data: bytes, at: int) -> None:
        left = memoryview(data)
        while left:
            count = os.pwrite(self._file, left, at)
            left, at = left[count:], at + count


class TailedWriter(Writer):  # type: ignore[misc]  # mcap says nothing of types
    """Writes a log into a file with a tail."""

    def __init__(self, file: TailedFile) -> None:
        self._file = file
        super().__init__(file, enable_data_crcs=True)

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """The number of a new schema."""
        number: int = super().register_schema(name, encoding, data)
        self._file.append(written(Schema(number, data, encoding, name)))
        return number

    def register_channel(
        self, topic: str, message_encoding: str, schema_id: int, metadata: dict[str, str] | None = None
    ) -> int:
        """The number of a new channel."""
        number: int = super().register_channel(topic, message_encoding, schema_id, metadata or {})
        self._file.append(written(Channel(number, topic, message_encoding, metadata or {}, schema_id)))
        return number

    def add_message(self, channel_id: int, log_time: int, data: bytes, publish_time: int, sequence: int = 0) -> None:
        """Append a message; OSError if there is no room for it, struct.error if a number has no room in its field."""
        head = MESSAGE.pack(Opcode.MESSAGE, MESSAGE_BYTES + len(data), channel_id, sequence, log_time, publish_time)
        self._file.append(head + data)
        super().add_message(channel_id, log_time, data, publish_time, sequence)
        self._file.flush()  # a chunk, if this completed one
