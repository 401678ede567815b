"""What was read of runs that have ended, kept between starts: a file that may be deleted, and is never needed."""

from __future__ import annotations

import hashlib
import json
import logging
import os
import sqlite3
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import fields
from pathlib import Path

from omnilab import __version__
from omnilab.client import RunRecord
from omnilab_serve.index.compact import compact
from omnilab_serve.index.folders import Stamp

FORMAT = 1

log = logging.getLogger("omnilab")


def cache_file(logs: Path) -> Path:
    """Where the records of a folder of logs are kept: for this user, on a disk of this machine."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "omnilab" / f"runs-{hashlib.sha256(os.fsencode(logs.resolve())).hexdigest()[:16]}.sqlite"


class RecordCache:
    """Records by path, each with the stamp of the run's status; of another version, or damaged, it begins anew.

    Used by one thread.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._database = self._opened()

    def _opened(self) -> sqlite3.Connection | None:
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            try:
                return _open(self._file)
            except sqlite3.DatabaseError:  # damaged, or no database
                self._file.unlink(missing_ok=True)
                return _open(self._file)
        except (OSError, sqlite3.Error) as error:
            log.warning("%s cannot be used (%s), so that the next start reads every run again", self._file, error)
            return None

    def load(self) -> Iterator[tuple[str, Stamp, RunRecord]]:
        """All that can be read."""
        try:
            rows = self._database.execute("SELECT path, stamp, record FROM runs") if self._database else []
            for path, text, content in rows:
                try:
                    time_ns, size, inode = map(int, text.split())
                    record = RunRecord(**json.loads(content))
                except (ValueError, TypeError, AttributeError, RecursionError):
                    continue  # it is read from its folder
                yield path, (time_ns, size, inode), compact(record)
        except sqlite3.Error as error:
            self._give_up(error)

    def save(self, records: Iterable[tuple[str, Stamp, RunRecord]], gone: Iterable[str] = ()) -> None:
        """Keep records of runs that have ended, and those of `gone` no longer."""
        if self._database is None:
            return
        rows = [(path, " ".join(map(str, when)), json.dumps(vars(record))) for path, when, record in records]
        try:
            with self._database:
                self._database.executemany("DELETE FROM runs WHERE path = ?", [(path,) for path in gone])
                self._database.executemany("INSERT OR REPLACE INTO runs VALUES (?, ?, ?)", rows)
        except (sqlite3.Error, UnicodeEncodeError) as error:
            self._give_up(error)

    def close(self) -> None:
        if self._database is not None:
            self._database.close()
            self._database = None

    def _give_up(self, error: Exception) -> None:
        log.warning("%s is left (%s), so that the next start reads more of the runs again", self._file, error)
        self.close()


def _open(file: Path) -> sqlite3.Connection:
    """The database, empty if it is of another version; sqlite3.Error if it is damaged."""
    database = sqlite3.connect(file, timeout=1.0)
    try:
        if database.execute("PRAGMA user_version").fetchone()[0] != _version():
            database.executescript("DROP TABLE IF EXISTS runs; VACUUM;")
            database.execute(f"PRAGMA user_version = {_version()}")
        database.execute(
            "CREATE TABLE IF NOT EXISTS runs (path TEXT PRIMARY KEY, stamp TEXT, record TEXT) WITHOUT ROWID"
        )
        database.commit()
    except BaseException:
        database.close()
        raise
    return database


def _version() -> int:
    """A number of what records are and of who made them."""
    names = " ".join(field.name for field in fields(RunRecord))
    return zlib.crc32(f"{FORMAT} {__version__} {names}".encode()) & 0x7FFFFFFF
