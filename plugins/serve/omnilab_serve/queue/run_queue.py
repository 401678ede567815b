"""The queue of submissions."""

from __future__ import annotations

from collections.abc import Sequence

from omnilab.client import Submission, SubmissionRequest
from omnilab_serve.composing import Composer
from omnilab_serve.events import Events
from omnilab_serve.settings import ServeSettings


class RunQueue:
    """Submissions, which outlive the process; each runs in a process of its own, which outlives it too."""

    def __init__(self, settings: ServeSettings, events: Events, composer: Composer) -> None:
        self._settings, self._events, self._composer = settings, events, composer  # check_request asks the composer

    def start(self) -> None:
        """Take up what is there: what still runs is watched, what waits is begun in its turn."""

    def stop(self) -> None:
        """Begin nothing more; what runs goes on."""

    def submissions(self) -> Sequence[Submission]:
        """All of them, the newest first."""
        return []

    def submission(self, identity: str) -> Submission | None:
        """One of them; None if there is none of that id."""
        raise NotImplementedError(identity)

    def submit(self, request: SubmissionRequest) -> Submission:
        """Put a run or a sweep into the queue; ConfigError for one that cannot be run, or if the queue is full."""
        raise NotImplementedError(request)

    def resume(self, path: str, retry_failed: bool = False) -> Submission:
        """Go on with a sweep, which may have been started elsewhere; DataError if it cannot."""
        raise NotImplementedError(path, retry_failed)

    def cancel(self, identity: str) -> Submission:
        """Take one out of the queue, or interrupt it as Ctrl-C does if it runs."""
        raise NotImplementedError(identity)

    def retry(self, identity: str) -> Submission:
        """Put one that has ended into the queue again; a sweep goes on where it is."""
        raise NotImplementedError(identity)

    def prioritise(self, identity: str, priority: int) -> Submission:
        """Another place in the queue; the larger, the sooner."""
        raise NotImplementedError(identity, priority)

    def interrupt(self, path: str) -> None:
        """Ctrl-C for the run or sweep in a folder, whoever started it on this machine; DataError if none runs there."""
        raise NotImplementedError(path)
