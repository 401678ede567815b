"""Repair of an MCAP log that is torn or damaged."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO

from google.protobuf.empty_pb2 import Empty  # type: ignore[import-untyped]
from mcap.records import Attachment, Channel, Header, McapRecord, Message, MessageIndex, Metadata, Schema
from mcap.writer import MCAP0_MAGIC, Writer
from mcap_protobuf.schema import register_schema

from omnilab.errors import DataError
from omnilab.log_files import is_there, replace_mended
from omnilab_mcap.damage import Damage, DamagedLog
from omnilab_mcap.summary import LogSummary

LOST = -1  # the number of a schema that there is not


def repair(path: Path) -> str | None:
    """Write a torn or damaged log anew with all its whole chunks and an index; None if it is whole or absent.

    A damaged one is kept beside, a torn one is not: what follows its last whole record are parts of one, or zeros.
    """
    if not is_there(path):
        return None
    with path.open("rb") as file:
        log = DamagedLog(file, path.stat().st_size)
        found = Findings(log.summary)
        for record in log:
            found.add(record)
        if not found.damages:
            return None
        if not found.records and not found.is_torn:
            start = _start(file)
            if start == MCAP0_MAGIC:
                raise DataError(f"{path} holds no record that can be read; run the experiment again")
            raise DataError(f"{path} is not an MCAP log (it starts with {start!r}); move it away")
        nameless: list[str] = []
        aside = replace_mended(path, lambda out: nameless.extend(copy(log, log.summary, out)), keep=not found.is_torn)
    if aside is None:
        return f"{path.name} was torn: {found.messages} messages were kept and indexed again"
    lost_names = f" (the names of some channels are lost: {', '.join(nameless)})" if nameless else ""
    return f"{path.name} was damaged: {found}{lost_names}; the damaged file is kept as {aside.name}"


def _start(file: BinaryIO) -> bytes:
    file.seek(0)
    return file.read(8)


@dataclass
class Findings:
    """What is whole in a log, and what is not."""

    summary: LogSummary | None
    records: int = 0
    messages: int = 0
    damages: list[Damage] = field(default_factory=list)  # those that touch are one
    _indexed: int = 0  # messages that were lost, as far as the message indexes behind their chunks tell
    _around_ns: list[int | None] = field(default_factory=list)  # log times of the messages before and after each loss
    _last_ns: int | None = None  # the log time of the last message
    _in_loss: bool = False

    def add(self, record: McapRecord | Damage) -> None:
        """Take note of the next record."""
        if isinstance(record, Damage):
            self._add_damage(record)
            return
        self.records += 1
        if isinstance(record, MessageIndex) and self._in_loss:
            self._indexed += len(record.records)
        elif isinstance(record, Message):
            self.messages += 1
            self._last_ns = record.log_time
            if self._in_loss:
                self._around_ns.append(record.log_time)
                self._in_loss = False

    def _add_damage(self, damage: Damage) -> None:
        if self.damages and self.damages[-1].end == damage.start:
            before = self.damages.pop()
            damage = replace(
                before, end=damage.end, torn=before.torn and damage.torn, messages=before.messages or damage.messages
            )
        self.damages.append(damage)
        if damage.messages and not self._in_loss:
            self._in_loss = True
            self._around_ns.append(self._last_ns)

    @property
    def is_torn(self) -> bool:
        """Whether the log is whole but for its end."""
        return all(damage.torn for damage in self.damages)

    def __str__(self) -> str:
        first, more = self.damages[0], len(self.damages) - 1
        places = f"{first.what} at bytes {first.start} to {first.end}"
        if more:
            places += f", and {more} other place" + "s" * (more > 1)
        kept = f"{self.messages} messages were kept and indexed again"
        return f"{places}; {kept}, {self._lost()}"

    def _lost(self) -> str:
        """How many messages were lost, and over which stretch of time."""
        if not any(damage.messages for damage in self.damages):
            return "none was lost"
        if self.summary and self.summary.statistics:
            count = max(self.summary.statistics.message_count - self.messages, 0)
            many = f"{count} {'was' if count == 1 else 'were'} lost" if count else "none was lost"
        else:
            count = self._indexed
            many = f"at least {count} {'was' if count == 1 else 'were'} lost" if count else "some may be lost"
        if many == "none was lost":
            return many
        return f"{many}, logged {self._span()}"

    def _span(self) -> str:
        chunks = [
            chunk
            for offset, chunk in (self.summary.chunks if self.summary else {}).items()
            if any(d.messages and offset < d.end and d.start < offset + chunk.chunk_length for d in self.damages)
        ]
        if chunks:
            start, end = min(c.message_start_time for c in chunks), max(c.message_end_time for c in chunks)
        else:
            start, end = self._around_ns[0], None if self._in_loss else self._around_ns[-1]
        since = "" if start is None else f"from {_clock(start)} "
        return since + (f"to {_clock(end)}" if end is not None else "to its end")


def _clock(time_ns: int) -> str:
    """A log time as one reads it: 2026-11-29 12:00:01.123 UTC."""
    return datetime.fromtimestamp(time_ns / 1e9, UTC).strftime("%Y-%m-%d %H:%M:%S.%f")[:-3] + " UTC"


def copy(records: Iterable[McapRecord | Damage], summary: LogSummary | None, target: BinaryIO) -> list[str]:
    """Write whole records into a new log with an index and all checksums.

    Schemas and channels that were damaged are those that the summary repeats. If that is damaged too, messages are kept
    without known fields, and those of a lost channel under a topic such as `/unknown_channel_3`; these topics are returned.
    """
    new = _Copy(summary, target)
    for record in records:
        if not isinstance(record, Damage):
            new.add(record)
    return new.finish()


class _Copy:
    """A log that is written anew, whose schemas and channels get numbers of their own."""

    def __init__(self, summary: LogSummary | None, target: BinaryIO) -> None:
        self._writer = Writer(target, enable_data_crcs=True)
        self._started = False
        self._schemas: dict[int, Schema] = dict(summary.schemas) if summary else {}
        self._channels: dict[int, Channel] = dict(summary.channels) if summary else {}
        self._new_schemas, self._new_channels = {0: 0}, dict[int, int]()
        self._nameless: list[str] = []

    def add(self, record: McapRecord) -> None:
        """The next whole record."""
        if not self._started:
            self._start(record.profile if isinstance(record, Header) else "")
        match record:
            case Schema():
                self._schemas.setdefault(record.id, record)
            case Channel():
                self._channels.setdefault(record.id, record)
                self._channel(record.id)
            case Metadata():
                self._writer.add_metadata(record.name, record.metadata)
            case Attachment():
                self._writer.add_attachment(
                    record.create_time, record.log_time, record.name, record.media_type, record.data
                )
            case Message():
                channel = self._channel(record.channel_id)
                self._writer.add_message(channel, record.log_time, record.data, record.publish_time, record.sequence)

    def finish(self) -> list[str]:
        """Write the index; the topics whose names are lost."""
        if not self._started:
            self._start("")
        self._writer.finish()
        return self._nameless

    def _start(self, profile: str) -> None:
        self._writer.start(profile)
        self._started = True

    def _channel(self, number: int) -> int:
        """The new number of a channel, which is registered when it is first asked for."""
        if number not in self._new_channels:
            found = self._channels.get(number)
            if found is None:
                found = Channel(number, f"/unknown_channel_{number}", "protobuf", {}, LOST)
                self._nameless.append(found.topic)
            self._new_channels[number] = self._writer.register_channel(
                found.topic, found.message_encoding, self._schema(found), found.metadata
            )
        return self._new_channels[number]

    def _schema(self, channel: Channel) -> int:
        """The new number of a channel's schema; of a lost one, that of a message without known fields."""
        if channel.schema_id not in self._new_schemas:
            if schema := self._schemas.get(channel.schema_id):
                new = self._writer.register_schema(schema.name, schema.encoding, schema.data)
            else:
                new = register_schema(self._writer, Empty) if channel.message_encoding == "protobuf" else 0
            self._new_schemas[channel.schema_id] = new
        return self._new_schemas[channel.schema_id]
