"""A client of `omnilab serve`, in the standard library alone."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

from omnilab.atomic_files import write_whole
from omnilab.client.connection import Connection
from omnilab.client.models import (
    CheckedRequest,
    ComponentRecord,
    LogTail,
    PluginFailure,
    RecipeRecord,
    RunFile,
    RunPage,
    RunRecord,
    Session,
    Submission,
    SubmissionRequest,
    SweepRecord,
)
from omnilab.client.reader import read, read_each
from omnilab.errors import DataError

T = TypeVar("T")
LIVE = {"queued", "running"}  # states of a submission that has not ended
POLL_S = 1.0


class Client:
    """Asks a server for runs, sweeps and what is installed, and for runs to be started and stopped.

    The address is that which `omnilab serve` prints, OMNILAB_SERVER, or http://127.0.0.1:8700; the token is in it, or
    OMNILAB_TOKEN. Runs and sweeps are called by the path of their folder below the server's logs.
    """

    def __init__(self, url: str | None = None, token: str | None = None) -> None:
        self._connection = Connection(url, token)
        self.url = self._connection.url

    # ------------------------------------------------------------------------------------------------ what there is
    def session(self) -> Session:
        """The server's version, and the token for changes."""
        return read(Session, self._connection.request("GET", "/api/session"))

    def runs(self, query: str = "", sort: str = "-started", offset: int = 0, limit: int = 100) -> RunPage:
        """Runs that a query matches, such as "descriptor:radon step_m>0.2", in an order such as "-recall_at_1"."""
        return self._get(RunPage, "/api/runs", {"q": query, "sort": sort, "offset": offset, "limit": limit})

    def run(self, path: str) -> RunRecord:
        """One run."""
        return self._get(RunRecord, f"/api/runs/{path}")

    def sweeps(self) -> Sequence[SweepRecord]:
        """All sweeps, the newest first, without their jobs."""
        return read_each(SweepRecord, self._connection.request("GET", "/api/sweeps"))

    def sweep(self, path: str) -> SweepRecord:
        """One sweep, with its jobs."""
        return self._get(SweepRecord, f"/api/sweeps/{path}")

    def compare(self, paths: Sequence[str]) -> Mapping[str, Any]:
        """How runs differ, as `omnilab compare --json` has it."""
        return read(dict[str, Any], self._connection.request("GET", "/api/compare", {"run": list(paths)}))

    def components(self) -> Sequence[ComponentRecord]:
        """What is installed there."""
        return read_each(ComponentRecord, self._connection.request("GET", "/api/components"))

    def recipes(self) -> Sequence[RecipeRecord]:
        """The experiments that are shipped there."""
        return read_each(RecipeRecord, self._connection.request("GET", "/api/recipes"))

    def recipe(self, name: str) -> Mapping[str, Any]:
        """A recipe's slots, what fills them, and every setting with its value."""
        return read(dict[str, Any], self._connection.request("GET", f"/api/recipes/{name}"))

    def run_settings(self) -> Sequence[Mapping[str, Any]]:
        """A run's own settings, beside those of its components, as `omnilab plugins --json` has them."""
        return read_each(dict[str, Any], self._connection.request("GET", "/api/run-settings"))

    def component(self, kind: str, name: str) -> ComponentRecord:
        """One of them."""
        return self._get(ComponentRecord, f"/api/components/{kind}/{name}")

    def failed_plugins(self) -> Sequence[PluginFailure]:
        """The plugins that could not be loaded there, and why."""
        return read_each(PluginFailure, self._connection.request("GET", "/api/failed-plugins"))

    # --------------------------------------------------------------------------------------------------------- files
    def files(self, path: str) -> Sequence[RunFile]:
        """The files of a run."""
        return read_each(RunFile, self._connection.request("GET", f"/api/files/{path}"))

    def download(self, path: str, name: str, to: Path) -> None:
        """A file of a run, by its name as in `files`, written to a place of yours once it is there whole."""
        write_whole(to, lambda out: out.writelines(self._connection.pieces(f"/files/{path}/{name}")))

    def report(self, path: str, to: Path) -> None:
        """A run or a sweep as one HTML file, as `omnilab report` writes it, written to a place of yours."""
        write_whole(to, lambda out: out.writelines(self._connection.pieces(f"/api/reports/{path}")))

    def log(self, path: str, lines: int = 200) -> LogTail:
        """The end of a run's log."""
        return self._get(LogTail, f"/api/log/{path}", {"lines": lines})

    # ------------------------------------------------------------------------------------------------- what is to run
    def check(self, request: SubmissionRequest) -> CheckedRequest:
        """What a request comes to, without running it; ConfigError with the builder's sentence for one that is refused."""
        return self._change(CheckedRequest, "/api/check", asdict(request))

    def submit(self, request: SubmissionRequest) -> Submission:
        """Put a run, or a sweep, into the queue."""
        return self._change(Submission, "/api/submissions", asdict(request))

    def submissions(self) -> Sequence[Submission]:
        """The queue, and what was in it, the newest first."""
        return read_each(Submission, self._connection.request("GET", "/api/submissions"))

    def submission(self, identity: str) -> Submission:
        """One of them."""
        return self._get(Submission, f"/api/submissions/{identity}")

    def output(self, identity: str) -> str:
        """The end of what its process has printed."""
        return self._get(str, f"/api/submissions/{identity}/output")

    def cancel(self, identity: str) -> Submission:
        """Take it out of the queue, or interrupt it."""
        return self._change(Submission, f"/api/submissions/{identity}/cancel")

    def retry(self, identity: str) -> Submission:
        """Put one that has ended into the queue again."""
        return self._change(Submission, f"/api/submissions/{identity}/retry")

    def prioritise(self, identity: str, priority: int) -> Submission:
        """The larger, the sooner."""
        return self._change(Submission, f"/api/submissions/{identity}/priority", {"priority": priority})

    def resume(self, path: str, retry_failed: bool = False) -> Submission:
        """Go on with a sweep."""
        return self._change(Submission, "/api/submissions/resume", {"path": path, "retry_failed": retry_failed})

    def interrupt(self, path: str) -> None:
        """Ctrl-C for the run or sweep of a path, whoever started it on the server's machine."""
        self._post("/api/submissions/interrupt", {"path": path})

    def wait(
        self, identity: str, timeout_s: float | None = None, watch: Callable[[Submission], None] | None = None
    ) -> Submission:
        """The submission once it has ended; `watch` is called with it every second until then."""
        until = None if timeout_s is None else time.monotonic() + timeout_s
        while (found := self.submission(identity)).state in LIVE:
            if watch:
                watch(found)
            if until is not None and time.monotonic() > until:
                raise DataError(f"submission {identity} has not ended within {timeout_s} s; it is {found.state}")
            time.sleep(POLL_S)
        return found

    # ----------------------------------------------------------------------------------------------------------- asking
    def _get(self, kind: type[T], path: str, query: Mapping[str, Any] | None = None) -> T:
        return read(kind, self._connection.request("GET", path, query))

    def _change(self, kind: type[T], path: str, body: object = None) -> T:
        return read(kind, self._post(path, body))

    def _post(self, path: str, body: object = None) -> Any:
        """Ask for a change, with the token for it, which is another whenever the server is started."""
        return self._connection.request("POST", path, None, body, self.session().csrf)
