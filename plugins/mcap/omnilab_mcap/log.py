"""Writer of an MCAP log."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from contextlib import closing
from importlib.metadata import version
from pathlib import Path

import numpy as np
from google.protobuf.message import Message  # type: ignore[import-untyped]
from mcap_protobuf.schema import register_schema

from omnilab.api import Record, RunResult, Tick
from omnilab.errors import DataError, PluginError
from omnilab.log_times import LogTimes
from omnilab.manifest import read_manifest
from omnilab_mcap import about
from omnilab_mcap.shown import Shown
from omnilab_mcap.writer import TailedFile, TailedWriter


class McapLog:
    """One channel per topic, one protobuf schema per channel, and the run's clock (see `LogTimes`)."""

    def __init__(self, path: Path) -> None:
        try:
            self._file = TailedFile(path)
        except OSError as error:
            raise DataError(
                f"{path} cannot be created ({error.strerror}); choose a new, writable run folder"
            ) from error
        self._writer = TailedWriter(self._file)
        self._writer.start()
        self.times = LogTimes()
        self.folder = path.parent
        self._about = about.of_run(read_manifest(path.parent)) | versions()
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, tuple[int, str]] = {}
        self.shown: dict[str, Shown] = {}  # by topic
        self._describe(about.RUN_FILES)

    def add(self, topic: str, message: Message, log_ns: int, tick: Tick) -> None:
        """Append one message; its sequence number is the study's step. It is with the operating system at once."""
        channel = self._channel(topic, message)
        try:
            self._writer.add_message(channel, log_ns, message.SerializeToString(), log_ns, tick.step)
        except struct.error as error:
            raise ValueError(f"step {tick.step} does not fit: steps have 32 bits, and none is negative") from error

    def add_rows(self, topic: str, rows: Iterable[tuple[Message, Tick]]) -> None:
        """Append the rows of a curve, each at the time of its step."""
        rows = list(rows)
        times = self.times.of_steps(np.array([tick.step for _, tick in rows], np.int64))
        for (message, tick), log_ns in zip(rows, times.tolist(), strict=True):
            self.add(topic, message, log_ns, tick)

    def see(self, topic: str, record: Record) -> None:
        """Take note, for the layout, of a record of which messages were added under a topic."""
        if topic in self._channels:
            self.shown.setdefault(topic, Shown(self._channels[topic][1])).see(record)

    def conclude(self, result: RunResult) -> None:
        """Say how the run ended; of records of one name the last holds."""
        self._about |= about.of_result(result)
        self._describe(about.RESULT_FILES)

    def _describe(self, media_types: dict[str, str]) -> None:
        """Write what is known of the run, and files of its folder, behind the chunk in progress."""
        self.flush()
        self._writer.add_metadata(about.NAME, self._about)
        for name, media_type, content in about.files(self.folder, media_types):
            now = self.times.now()
            self._writer.add_attachment(now, now, name, media_type, content)
        self.flush()

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
