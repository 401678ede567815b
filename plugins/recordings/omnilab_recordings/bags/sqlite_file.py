"""SQLite databases of ROS 2 (.db3): the tables `topics` and `messages` that rosbag2 writes."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from pathlib import Path

from omnilab_recordings.bags.message import LARGEST_BYTES, Damaged, LogMessage, Place

ZSTD = b"\x28\xb5\x2f\xfd"


class SqliteFile:
    """A database. A place is (row number,)."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.damage: str | None = None
        self._opened: sqlite3.Connection | None = None

    @property
    def _database(self) -> sqlite3.Connection:
        if self._opened is None:
            uri = f"{self.path.absolute().as_uri()}?mode=ro&immutable=1"
            self._opened = sqlite3.connect(uri, uri=True, check_same_thread=False)
            self._opened.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST_BYTES)
            self._opened.text_factory = lambda text: text.decode("utf-8", "replace")
            self._opened.execute("PRAGMA trusted_schema=OFF")
        return self._opened

    def messages(self) -> Iterator[LogMessage]:
        """Every message, in the order of the record times."""
        rows = (
            "SELECT messages.rowid, topics.name, topics.type, topics.serialization_format, messages.timestamp, messages.data"
            " FROM messages JOIN topics ON messages.topic_id = topics.id ORDER BY messages.timestamp, messages.rowid"
        )
        try:
            for row, topic, kind, encoding, time, data in self._database.execute(rows):
                if not isinstance(data, bytes) or not isinstance(time, int):
                    raise Damaged("a message that is none")
                if data.startswith(ZSTD):
                    raise Damaged(
                        "messages packed one by one (zstd), which are not read: ros2 bag convert unpacks them"
                    )
                yield LogMessage(str(topic), str(kind), str(encoding), time, memoryview(data), (row,))
        except (sqlite3.Error, UnicodeDecodeError) as error:  # the library's own messages quote the file
            self.damage = f"a database that cannot be read ({error})"
        except Damaged as damaged:
            self.damage = str(damaged)

    def read(self, place: Place) -> memoryview:
        """The bytes of one message again; Damaged if they are no longer there."""
        try:
            found = self._database.execute("SELECT data FROM messages WHERE rowid = ?", place).fetchone()
        except sqlite3.Error as error:
            raise Damaged(f"a database that cannot be read ({error})") from error
        if found is None:
            raise Damaged("a message that is no longer there")
        return memoryview(found[0])

    def attachments(self) -> dict[str, bytes]:
        """None: a database of rosbag2 has none."""
        return {}

    def close(self) -> None:
        """Until it is read from again."""
        if self._opened is not None:
            self._opened.close()
            self._opened = None
