"""The queue of submissions."""

from __future__ import annotations

import logging
import secrets
import subprocess
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from omnilab.client import StageProgress, Submission, SubmissionRequest
from omnilab.errors import ConfigError, DataError
from omnilab.runner.run_folder import FAILED, RUNNING, process
from omnilab_serve.composing import Composer, check_request
from omnilab_serve.events import QUEUE, Events
from omnilab_serve.queue import children, commands
from omnilab_serve.queue.folder_state import ended_state, progress_of, state_of
from omnilab_serve.queue.interrupting import interrupt_holder
from omnilab_serve.queue.recovery import taken_up
from omnilab_serve.queue.submission_file import (
    ACTIVE,
    CANCELLED,
    MOST_PRIORITY,
    QUEUED,
    Attempt,
    SubmissionFile,
    check_priority,
    now,
)
from omnilab_serve.queue.submission_store import SubmissionStore
from omnilab_serve.queue.workers import Workers
from omnilab_serve.settings import ServeSettings

MULTIRUN = ("-m", "--multirun")
MOST_QUEUED = 1000
WATCHED_FIRST = 2 * MOST_PRIORITY  # what runs already has its worker before anything is begun
POLL_S, PUBLISH_S = 0.2, 1.0  # how often a process is looked at, and its progress shown
AGAIN_S = 10.0  # after which a full disk is tried again
PATIENCE_S = 2.0  # a second word to end within this time is the first one, said twice

log = logging.getLogger("omnilab")


class RunQueue:
    """Submissions, which outlive the process; each runs in a process of its own, which outlives it too.

    The files are the truth; recovery.py has what follows from them after a restart.
    """

    def __init__(self, settings: ServeSettings, events: Events, composer: Composer) -> None:
        self._settings, self._events, self._composer = settings, events, composer
        self._store = SubmissionStore(settings.logs, events)
        self._records, self._mutex = self._store.records, self._store.mutex
        self._checked: set[str] = set()  # those whose words this process has checked
        self._told_s: dict[str, float] = {}  # when one was told to end last
        self._shown: dict[str, tuple[float, StageProgress | None]] = {}  # progress, and when it was read
        self._stopping = threading.Event()
        self._workers: Workers | None = None

    # ------------------------------------------------------------------------------------------- the service's life
    def start(self) -> None:
        """Take up what is there: what still runs is watched, what waits is begun in its turn.

        DataError if another service works on these logs.
        """
        self._store.claim()
        self._stopping.clear()
        self._store.load()
        self._workers = Workers(self._store.folder / "huey.sqlite", self._settings.workers, self._take)
        active = [record for record in self._records.values() if record.state in ACTIVE]
        for record in active:
            self._store.note(taken_up(record, self._settings.logs, self._lives, self._store.output))
        for record in sorted((self._records[each.id] for each in active), key=lambda each: each.order):
            if record.state in ACTIVE:
                self._workers.add(record.id, WATCHED_FIRST if record.state == RUNNING else record.priority)
        self._workers.start()

    def stop(self) -> None:
        """Begin nothing more; what runs goes on."""
        with self._mutex:  # nothing is being begun
            self._stopping.set()
            if self._workers is not None:
                self._workers.stop()
            self._store.release()

    # ------------------------------------------------------------------------------------------- what others ask for
    def submissions(self) -> Sequence[Submission]:
        """All of them, the newest first."""
        with self._mutex:
            found = sorted(self._records.values(), key=lambda each: each.queued_s, reverse=True)
        return [self._public(record) for record in found]

    def waiting(self) -> Sequence[Submission]:
        """Those that have not begun, in their order."""
        with self._mutex:
            found = [record for record in self._records.values() if record.state == QUEUED]
        return [self._public(record) for record in sorted(found, key=lambda each: each.order)]

    def submission(self, identity: str) -> Submission | None:
        """One of them; None if there is none of that id."""
        record = self._records.get(identity)
        return self._public(record) if record else None

    def output(self, identity: str) -> str:
        """The end of what the last process of a submission has printed."""
        record = self._record(identity)
        return children.tail(self._store.output(record)) if record.starts else ""

    def submit(self, request: SubmissionRequest) -> Submission:
        """Put a run or a sweep into the queue; ConfigError for one that cannot be run, or if the queue is full."""
        check_priority(request.priority)
        self._check_room()
        composed = check_request(request, self._composer)
        return self._queued(
            SubmissionFile(
                secrets.token_hex(6), list(request.overrides), list(composed.command), **self._here(),
                experiment=composed.experiment, jobs=composed.jobs, priority=request.priority,
                launcher=request.launcher, sweep=composed.is_sweep,
            )
        )  # fmt: skip

    def resume(self, path: str, retry_failed: bool = False) -> Submission:
        """Go on with a sweep, which may have been started elsewhere; DataError if it cannot."""
        folder = self._below(path)
        commands.check_idle(folder, path)
        of_it = [record for record in self._records.values() if record.sweep and record.path == path]
        if any(record.state in ACTIVE for record in of_it):
            raise DataError(f"{path} is in the queue already")
        for record in of_it:
            if not record.resumes:  # its words were checked, and are once more
                return self._again(record, retry_failed)
        plan = commands.resumable(folder, path)
        new = SubmissionFile(
            secrets.token_hex(6), [word for word in plan.command if word not in MULTIRUN], [], **self._here(), experiment=plan.experiment,
            jobs=plan.jobs or 0, launcher=plan.launcher, sweep=True, resumes=path, retry_failed=retry_failed,
        )  # fmt: skip
        return self._queued(new)

    def cancel(self, identity: str) -> Submission:
        """Take one out of the queue; interrupt one that runs as Ctrl-C does, the second time by SIGTERM, then by SIGKILL."""
        with self._mutex:
            record = self._record(identity)
            if record.state == QUEUED:
                return self._public(self._store.put(replace(record, state=CANCELLED, ended=now())))
            if record.state != RUNNING:
                raise DataError(f"submission {identity} has ended ({record.state}); there is nothing to cancel")
            if record.signals and time.monotonic() - self._told_s.get(identity, 0.0) < PATIENCE_S:
                return self._public(record)
            record = self._store.put(replace(record, signals=record.signals + 1))
            self._told_s[identity] = time.monotonic()
            if (holder := record.starts[-1].process) is not None:  # else whoever watches it comes to know it
                children.tell_to_end(holder, record.signals)
            return self._public(record)

    def retry(self, identity: str) -> Submission:
        """Put one that has ended into the queue again; a sweep goes on where it is."""
        record = self._record(identity)
        if record.state in ACTIVE:
            raise DataError(f"submission {identity} is {record.state}; only one that has ended can be tried again")
        if record.resumes:
            commands.resumable(self._below(record.resumes), record.resumes)
        return self._again(record, retry_failed=record.state == FAILED)

    def prioritise(self, identity: str, priority: int) -> Submission:
        """Another place in the queue; the larger, the sooner."""
        check_priority(priority)
        with self._mutex:
            record = self._record(identity)
            if record.state != QUEUED:
                raise DataError(f"submission {identity} is {record.state}; only what waits has a place in the queue")
            if priority != record.priority:
                record = self._store.put(replace(record, priority=priority, queued_s=time.time()))
                self._add(record)
            return self._public(record)

    def interrupt(self, path: str) -> None:
        """Ctrl-C for the run or sweep in a folder, whoever started it on this machine; DataError if none runs there."""
        folder = self._below(path)
        for record in list(self._records.values()):
            if record.state == RUNNING and record.path == path:
                self.cancel(record.id)
                return
        interrupt_holder(folder, path)

    def _again(self, record: SubmissionFile, retry_failed: bool) -> Submission:
        self._check_room()
        words = [] if record.resumes else list(check_request(_request(record), self._composer).command)
        return self._queued(
            replace(
                record, words=words, **self._here(), retry_failed=retry_failed, state=QUEUED, queued_s=time.time(),
                restarts=0, signals=0, ended=None, error=None,
            )
        )  # fmt: skip

    def _queued(self, record: SubmissionFile) -> Submission:
        with self._mutex:
            self._check_room()
            if (before := self._records.get(record.id)) and before.state in ACTIVE:
                raise DataError(f"submission {record.id} is {before.state} already")
            self._store.put(record)
            self._checked.add(record.id)
            self._add(record)
        return self._public(record)

    def _check_room(self) -> None:
        with self._mutex:
            queued = sum(record.state == QUEUED for record in self._records.values())
        if queued >= MOST_QUEUED:
            raise ConfigError(f"{queued} submissions wait already, as many as may; cancel some, or wait")

    def _here(self) -> dict[str, Any]:
        return {
            "directory": str(Path.cwd()),
            "logs": str(self._settings.logs),
            "machine": process.machine_id(),
        }

    def _below(self, path: str) -> Path:
        """A folder below the logs; DataError for one elsewhere."""
        logs, folder = self._settings.logs.resolve(), (self._settings.logs / path).resolve()
        if not folder.is_relative_to(logs) or folder == logs or not folder.is_dir():
            raise DataError(f"there is no folder {path} in the logs")
        return folder

    def _record(self, identity: str) -> SubmissionFile:
        if (record := self._records.get(identity)) is None:
            raise DataError(f"there is no submission {identity}")
        return record

    def _public(self, record: SubmissionFile) -> Submission:
        found = record.public()
        if record.state != RUNNING or found.path is None:
            return found
        read_s, progress = self._shown.get(record.id, (-PUBLISH_S, None))
        if time.monotonic() - read_s >= PUBLISH_S:  # however many look
            progress = progress_of(self._settings.logs / found.path, record.sweep)
            self._shown[record.id] = time.monotonic(), progress
        return replace(found, progress=progress)

    # ------------------------------------------------------------------------------------------- what workers do
    def _add(self, record: SubmissionFile) -> None:
        if self._workers is not None:
            self._workers.add(record.id, record.priority)

    def _take(self, identity: str, priority: int) -> None:
        """Begin a submission, or go on watching one that was begun by the service before."""
        record, child = self._records[identity], None
        if record.state == RUNNING and priority == WATCHED_FIRST:
            if record.signals and (holder := record.starts[-1].process):
                children.tell_to_end(holder, record.signals)  # the service may have been killed before it did
        else:
            try:
                self._check_again(identity)
                child = self._begin(identity, priority)
            except DataError as error:  # a full disk, a machine that is too busy to check it
                log.warning("%s", error)
                self._stopping.wait(AGAIN_S)
                self._add(self._records[identity])
            if child is None:
                return
        self._watch(identity, child)

    def _check_again(self, identity: str) -> None:
        """Check the words of a submission that was not made to this process: its file may be anybody's."""
        record = self._records[identity]
        if record.state != QUEUED or record.resumes or identity in self._checked:
            return
        try:
            composed = check_request(_request(record), self._composer)
            known: dict[str, Any] = {
                "words": list(composed.command),
                "experiment": composed.experiment,
                "sweep": composed.is_sweep,
            }
        except ConfigError as error:
            known = {"state": FAILED, "ended": now(), "error": str(error)}
        with self._mutex:
            if self._records[identity].state == QUEUED and not self._stopping.is_set():
                self._store.put(replace(self._records[identity], **known))
                self._checked.add(identity)

    def _begin(self, identity: str, priority: int) -> subprocess.Popen[bytes] | None:
        """Start the process of a submission; None if it is not to be begun (now), or cannot, as its file then says."""
        with self._mutex:
            record = self._records[identity]
            if record.state == QUEUED and record.priority == priority and not self._stopping.is_set():
                return self._started(record)
        return None

    def _started(self, record: SubmissionFile) -> subprocess.Popen[bytes] | None:
        path = record.path if record.sweep and record.path else commands.new_path(record.experiment)
        start = Attempt(path, now())
        record = self._store.put(replace(record, state=RUNNING, starts=[*record.starts, start], ended=None, error=None))
        words = commands.words_of(record, self._settings.logs)
        try:
            child = children.start_child(words, record.directory, self._store.output(record), record.mark)
        except OSError as error:
            self._store.note(replace(record, state=FAILED, ended=now(), error=f"no process could be started ({error})"))
            return None
        known = replace(start, process=children.holder_of(child.pid))
        self._store.note(replace(record, starts=[*record.starts[:-1], known]))
        return child

    def _watch(self, identity: str, child: subprocess.Popen[bytes] | None) -> None:
        """Wait until the process of a submission has ended, and write down how; nothing once the service stops."""
        shown_s, code = time.monotonic(), None
        while not self._stopping.wait(POLL_S):
            record = self._records[identity]
            if record.state != RUNNING:
                return
            code = child.poll() if child is not None else None
            if code is not None or (child is None and not self._lives(record)):
                self._end(identity, code)
                return
            if record.starts[-1].process is None:
                self._identify(identity)
            if time.monotonic() - shown_s > PUBLISH_S:
                shown_s = time.monotonic()
                self._events.publish(QUEUE)
        if child is not None:
            child.returncode = 0  # it goes on without us, and Python need not warn of that

    def _lives(self, record: SubmissionFile) -> bool:
        return children.lives(record.starts[-1], self._store.output(record), record.mark)

    def _identify(self, identity: str) -> None:
        """Find a process whose number the service before could not write down."""
        if (pid := children.marked(self._records[identity].mark)) is None:
            return
        with self._mutex:
            record, holder = self._records[identity], children.holder_of(pid)
            if not self._stopping.is_set():
                self._store.note(
                    replace(record, starts=[*record.starts[:-1], replace(record.starts[-1], process=holder)])
                )
                if record.signals:
                    children.tell_to_end(holder, record.signals)

    def _end(self, identity: str, code: int | None) -> None:
        record = self._records[identity]
        found = state_of(self._settings.logs / record.starts[-1].path, record.sweep, record.starts[-1].time)
        with self._mutex:
            if not self._stopping.is_set():
                record = self._records[identity]
                how = ended_state(found, code, record.signals, children.tail(self._store.output(record)))
                self._store.note(replace(record, state=how.state, error=how.error, ended=now()))


def _request(record: SubmissionFile) -> SubmissionRequest:
    return SubmissionRequest(record.overrides, record.priority, record.launcher)
