"""Writer of an MCAP log."""

from __future__ import annotations

import time
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path

from google.protobuf.message import Message  # type: ignore[import-untyped]
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema

from omnilab.api import Tick
from omnilab.errors import DataError, PluginError


class McapLog:
    """One channel per topic, one protobuf schema per channel, and the run's clock (log times never step back)."""

    def __init__(self, path: Path) -> None:
        try:
            self._file = path.open("xb")
        except OSError as error:
            raise DataError(
                f"{path} cannot be created ({error.strerror}); choose a new, writable run folder"
            ) from error
        self._writer = Writer(self._file, enable_data_crcs=True)
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
        """Append one message; its sequence number is the study's step."""
        channel = self._channel(topic, message)
        self._writer.add_message(channel, log_ns, message.SerializeToString(), tick.stamp_ns, tick.step)

    def add_rows(self, topic: str, rows: Iterable[tuple[Message, Tick]]) -> None:
        """Append the rows that came in since the topic's last ones, with log times spread evenly over that while."""
        rows, since, now = list(rows), self._rows_until.get(topic, self._opened), self.now()
        for i, (message, tick) in enumerate(rows, start=1):
            self.add(topic, message, since + (now - since) * i // len(rows), tick)
        self._rows_until[topic] = now

    def flush(self) -> None:
        """Complete the chunk in progress and hand it to the operating system."""
        self._writer.flush()

    def close(self) -> None:
        """Complete the file with its index."""
        with self._file:
            self._writer.finish()

    def _channel(self, topic: str, message: Message) -> int:
        kind = message.DESCRIPTOR.full_name
        if topic not in self._channels:
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
