"""Writer of an MCAP log."""

from __future__ import annotations

import struct
import time
from collections.abc import Iterable
from contextlib import closing
from importlib.metadata import version
from pathlib import Path

from google.protobuf.message import Message  # type: ignore[import-untyped]
from mcap_protobuf.schema import register_schema

from omnilab.api import Tick
from omnilab.errors import DataError, PluginError
from omnilab_mcap.writer import TailedFile, TailedWriter


class McapLog:
    """One channel per topic, one protobuf schema per channel, and the run's clock (log times never step back)."""

    def __init__(self, path: Path) -> None:
        try:
            self._file = TailedFile(path)
        except OSError as error:
            raise DataError(
                f"{path} cannot be created ({error.strerror}); choose a new, writable run folder"
            ) from error
        self._writer = TailedWriter(self._file)
        self._writer.start()
        self._writer.add_metadata("omnilab", {"run": path.parent.name} | versions())
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, tuple[int, str]] = {}
        self._now = time.time_ns()
        self._opened = self._now
        self._rows_until: dict[str, int] = {}
        self.flush()

    def now(self) -> int:
        """The run's clock, ns since 1970."""
        self._now = max(self._now, time.time_ns())
        return self._now

    def add(self, topic: str, message: Message, log_ns: int, tick: Tick) -> None:
        """Append one message; its sequence number is the study's step. It is with the operating system at once."""
        channel = self._channel(topic, message)
        try:
            self._writer.add_message(channel, log_ns, message.SerializeToString(), tick.stamp_ns, tick.step)
        except struct.error as error:
            raise ValueError(f"{tick} does not fit: steps have 32 bits, times 64, none is negative") from error

    def add_rows(self, topic: str, rows: Iterable[tuple[Message, Tick]]) -> None:
        """Append the rows that came in since the topic's last ones, with log times spread evenly over that while."""
        rows, since, now = list(rows), self._rows_until.get(topic, self._opened), self.now()
        for i, (message, tick) in enumerate(rows, start=1):
            self.add(topic, message, since + (now - since) * i // len(rows), tick)
        self._rows_until[topic] = now

    def flush(self) -> None:
        """Complete the chunk in progress."""
        self._writer.flush()

    def close(self) -> None:
        """Complete the file with its index; OSError without room, and what was added can be read back."""
        with closing(self._file):
            self._writer.flush()  # a whole chunk is smaller than its records: on a full disk it makes room
            self._writer.finish()
            self._file.flush()

    def _channel(self, topic: str, message: Message) -> int:
        kind = message.DESCRIPTOR.full_name
        if topic not in self._channels:
            topic.encode()  # before the writer takes note of it
            if kind not in self._schemas:
                self._schemas[kind] = register_schema(self._writer, type(message))
            self._channels[topic] = self._writer.register_channel(topic, "protobuf", self._schemas[kind]), kind
        channel, known = self._channels[topic]
        if kind != known:
            raise PluginError(f"'{topic}' holds {known}, not {kind}; log one kind of record under one path")
        return channel


def versions() -> dict[str, str]:
    """The distributions that had a hand in the file."""
    return {name: version(name) for name in ("omnilab", "omnilab-mcap", "mcap", "protobuf")}
