"""What to make of submissions when the service starts again, wherever the one before was killed.

A submission is begun in these steps, and its file says which have been made:

1. the file says `running`, in a new folder, without a process   no process, no folder: it waits again
2. its output is locked, and then its process is started         locked: it is watched; free, and no folder: it waits again
3. the file names the process                                    it lives: it is watched, and nothing is begun in its stead
4. the process has ended, and its folder says how                so has the submission
   it is gone, and its folder does not say that it ended         it is begun again: a run in a new folder, a sweep where it is
5. the file says how it ended                                    nothing is left to do

Between 1 and 2 nothing runs; from 2 on the lock is held as long as the process lives, whether or not it was written down.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from omnilab.runner.run_folder import KILLED, process
from omnilab_serve.queue.children import tail
from omnilab_serve.queue.folder_state import FINISHED, FolderState, ended_state, state_of
from omnilab_serve.queue.submission_file import CANCELLED, QUEUED, SubmissionFile, now

MOST_RESTARTS = 3  # of a submission whose process is gone each time: it may be what brings the machine down


def taken_up(
    record: SubmissionFile,
    logs: Path,
    lives: Callable[[SubmissionFile], bool],
    output: Callable[[SubmissionFile], Path],
) -> SubmissionFile:
    """How a submission stands that waited, or ran, when the service before ended."""
    elsewhere = (record.logs, record.machine) != (str(logs), process.machine_id())
    if record.state == QUEUED:
        return _here(record, elsewhere)
    if not elsewhere and lives(record):
        return record
    start, folder = record.starts[-1], logs / record.starts[-1].path
    found = state_of(folder, record.sweep, start.time)
    if found and found.state in FINISHED:
        return _ended(record, found)
    if elsewhere:
        return _ended(record, FolderState(KILLED, _of_elsewhere(record)))
    if record.signals:
        return _ended(record, ended_state(found, None, record.signals, tail(output(record))))
    if start.process is None and not folder.exists():
        return _here(replace(record, state=QUEUED, starts=record.starts[:-1]), elsewhere)
    if record.restarts >= MOST_RESTARTS:
        why = (
            f"each time the service started again ({record.restarts + 1} times), its process was gone; retry it by hand"
        )
        return _ended(record, FolderState(KILLED, why))
    return _here(replace(record, state=QUEUED, restarts=record.restarts + 1), elsewhere)


def _here(record: SubmissionFile, elsewhere: bool) -> SubmissionFile:
    """One that is to be begun, if it would be here what it was when it was submitted."""
    if elsewhere or record.directory != str(Path.cwd()):
        return _ended(record, FolderState(CANCELLED, _of_elsewhere(record)))
    return record


def _ended(record: SubmissionFile, how: FolderState) -> SubmissionFile:
    return replace(record, state=how.state, error=how.error, ended=now())


def _of_elsewhere(record: SubmissionFile) -> str:
    return (
        f"it was submitted on another machine, for other logs ({record.logs}), or to a service that was started in another"
        f" folder ({record.directory}), where words may mean other files; retry it to run it here"
    )
