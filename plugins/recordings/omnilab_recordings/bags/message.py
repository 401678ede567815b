"""What the files of a log hold: messages by topic."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import BinaryIO, NamedTuple, Protocol

from omnilab.file_kinds import opened

Place = tuple[int, ...]  # where a message lies in a file, as that file's kind has it

LARGEST_FILE = 2**44  # bytes
LARGEST_BYTES = 2**30  # of a record, and of what a chunk unpacks to: held in memory


class LogMessage(NamedTuple):
    """One message, not yet decoded."""

    topic: str
    kind: str  # the name of its type: sensor_msgs/Image, foxglove.RawImage
    encoding: str  # of its bytes: ros1, cdr, protobuf or another
    record_ns: int  # when it was recorded
    data: memoryview
    place: Place


class LogFile(Protocol):
    """One file of a log, open while it is read from. A file that is damaged or cut off is read up to there."""

    damage: str | None  # what is wrong with it, once its messages were gone through

    def messages(self) -> Iterator[LogMessage]:
        """Every message, in the file's order."""

    def read(self, place: Place) -> memoryview:
        """The bytes of one message again."""

    def attachments(self) -> dict[str, bytes]:
        """Small files that travel with the log, by name, once its messages were gone through."""

    def close(self) -> None:
        """Until it is read from again."""


class Damaged(Exception):
    """The rest of a file cannot be read, in a few words."""


class BinaryFile:
    """A file of records, opened when it is read from; the chunks that were read last are kept."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.damage: str | None = None
        self._opened: BinaryIO | None = None
        self._chunk = lru_cache(maxsize=2)(self._read_chunk)

    @property
    def _file(self) -> BinaryIO:
        if self._opened is None:
            self._opened = opened(self.path, LARGEST_FILE)
        return self._opened

    def read(self, place: Place) -> memoryview:
        """The bytes of one message again; Damaged if they are no longer there."""
        chunk, at, size = place
        if chunk >= 0:
            return self._chunk(chunk)[at : at + size]
        self._file.seek(at)
        return memoryview(self._exactly(size))

    def _read_chunk(self, at: int) -> memoryview:
        """The content of a chunk."""
        raise NotImplementedError

    def _exactly(self, size: int) -> bytes:
        if size > LARGEST_BYTES:
            raise Damaged(f"a record of {size} bytes, more than are read")
        data = self._file.read(size)
        if len(data) < size:
            raise Damaged("the end is cut off")
        return data

    def _check_whole(self, end: int) -> None:
        """Damaged if the file ends before that."""
        if self._file.seek(0, 2) < end:
            raise Damaged("the end is cut off")

    def attachments(self) -> dict[str, bytes]:
        """Small files that travel with the log; a kind of file may have none."""
        return {}

    def close(self) -> None:
        """Until it is read from again."""
        self._chunk.cache_clear()
        if self._opened is not None:
            self._opened.close()
            self._opened = None
