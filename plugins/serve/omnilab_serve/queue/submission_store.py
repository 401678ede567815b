"""The folder of the queue: a file for each submission, what its processes have printed, and the lock of the service."""

from __future__ import annotations

import logging
import re
import threading
from pathlib import Path

from omnilab.atomic_files import PART
from omnilab.errors import DataError
from omnilab.runner.run_folder.lock import RunLock, lock_state
from omnilab_serve.events import QUEUE, Events
from omnilab_serve.queue.submission_file import ACTIVE, SubmissionFile, read_submission

FOLDER = ".queue"  # in the logs; hidden, as it is no run
MOST_ENDED = 1000  # submissions that are kept when the service starts; their runs are not touched

log = logging.getLogger("omnilab")


class SubmissionStore:
    """What the files say, by id, in `records`; both change together, under `mutex`."""

    def __init__(self, logs: Path, events: Events) -> None:
        self.folder, self.records = logs / FOLDER, dict[str, SubmissionFile]()
        self.mutex = threading.RLock()
        self._events = events
        self._lock: RunLock | None = None

    def claim(self) -> None:
        """Keep other services away; DataError if another one is there."""
        self.folder.mkdir(parents=True, exist_ok=True)
        try:
            self._lock = RunLock.take(self.folder, purpose="serve")
        except DataError as error:
            found = lock_state(self.folder)
            who = found.words if found else str(error)
            raise DataError(
                f"another omnilab serve works on {self.folder.parent} {who}; use its page, or give another --logs"
            ) from error

    def release(self) -> None:
        """Let other services in."""
        if self._lock is not None:
            self._lock.release()
            self._lock = None

    def load(self) -> None:
        """Read all files; those that cannot be read are left alone, and the oldest of very many that ended go."""
        for part in self.folder.iterdir():
            if re.search(rf"{PART}$", part.name):
                part.unlink(missing_ok=True)
        self.records.clear()
        for file in self.folder.glob("*.json"):
            try:
                self.records[file.stem] = read_submission(file)
            except DataError as error:
                log.warning("%s", error)
        ended = [record for record in self.records.values() if record.state not in ACTIVE]
        for record in sorted(ended, key=lambda each: each.ended or "", reverse=True)[MOST_ENDED:]:
            for file in (*self.folder.glob(f"{record.id}-*.log"), self.folder / f"{record.id}.json"):
                file.unlink(missing_ok=True)
            del self.records[record.id]

    def put(self, record: SubmissionFile) -> SubmissionFile:
        """The file first; DataError if the disk does not take it, and then nothing has changed."""
        with self.mutex:
            record.write(self.folder)
            self.records[record.id] = record
        self._events.publish(QUEUE)
        return record

    def note(self, record: SubmissionFile) -> None:
        """What has happened, whether or not the disk takes it: it can be told again from the folders."""
        try:
            self.put(record)
        except DataError as error:
            log.warning("%s", error)
            self.records[record.id] = record

    def output(self, record: SubmissionFile) -> Path:
        """The file for what the last process of a submission prints."""
        return self.folder / f"{record.mark}.log"
