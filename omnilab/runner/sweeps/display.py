"""What a sweep shows while it runs: one process draws, from what all jobs write into the sweep's folder."""

from __future__ import annotations

import logging
import sys
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Self

from omnilab.errors import OmnilabError
from omnilab.runner.console_sink import Console
from omnilab.runner.sweeps.job_log import PLANNED
from omnilab.runner.sweeps.snapshot import BAD, Snapshot, snapshot
from omnilab.runner.sweeps.state import Job, LoadedSweep
from omnilab.runner.sweeps.status_table import board, overall, what_happened
from omnilab.runner.terminal import print_error

if TYPE_CHECKING:
    from rich.console import Console as RichConsole
    from rich.live import Live

EVERY_S = 0.5  # how often running jobs are asked how far they are
SHARE = 20  # so many times what a look took passes until the next: a twentieth of a core, however many jobs there are
JOIN_S = 10.0  # how long the end waits for a look that is being taken
MOST_LINES = 20  # about jobs that ended badly, at the end
SERIAL = "basic"  # the launcher whose jobs run in this process, one after the other, and draw their own bars

log = logging.getLogger("omnilab")


class SweepDisplay:
    """Shows, from when it is entered until it is left, how the jobs of a sweep stand, which `load` reads.

    On a terminal a table of jobs and a bar, elsewhere a line for each change; of jobs that run in this process one after
    the other, a line above their own bars. Whatever goes wrong here costs the sweep nothing.
    """

    def __init__(self, load: Callable[[], LoadedSweep], console: RichConsole | None = None, leads: bool = True) -> None:
        """`leads`: this is the process that leads the sweep, and does not only look on."""
        self._load, self._console, self._leads = load, console, leads
        self._live: Live | None = None
        self._serial = self._speaks = False  # how it shows: above the jobs' own bars, by lines, or else by a table
        self._seen: Snapshot | None = None
        self._states: dict[int, str] | None = None  # of jobs, as they were shown; None before the first look
        self._changed: set[int] = set()  # jobs
        self._next_s = 0.0  # when the sweep is read again
        self._ends = threading.Event()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        from rich.console import Console as RichConsole
        from rich.live import Live

        self._ends.clear()
        self._changed.clear()  # a sweeper that hands out batches has it entered for each
        console = self._console or RichConsole(stderr=True)
        seen = self._read(anew=True)
        plan = seen.sweep.plan if seen else None
        self._serial = bool(self._leads and plan and plan.launcher == SERIAL)
        self._speaks = not console.is_terminal or console.is_dumb_terminal
        if not self._serial and not self._speaks:
            self._live = Live(console=console, auto_refresh=False, transient=True, redirect_stdout=sys.stdout.isatty())
            self._live.start()
        Console.quiet = not self._serial
        self._thread = threading.Thread(target=self._keep_shown, name="omnilab-display", daemon=True)
        self._thread.start()
        return self

    @property
    def goes_on(self) -> bool:
        """Whether the sweep did when it was looked at last, and somebody looks."""
        looks = self._thread is not None and self._thread.is_alive()
        return looks and self._seen is not None and self._seen.goes_on

    def __exit__(self, *_: object) -> None:
        try:
            self._ends.set()
            if self._thread is not None:
                self._thread.join(JOIN_S)
        finally:
            Console.quiet, Console.heading = False, ""
            if (live := self._live) is not None:
                self._live = None
                live.stop()
                self._say_bad()

    def _keep_shown(self) -> None:
        try:
            while True:
                last, start_s = self._ends.is_set(), time.monotonic()
                if (seen := self._read(anew=last or start_s >= self._next_s)) is not None:
                    self._show(seen)
                if last:
                    return
                self._ends.wait(max(EVERY_S, SHARE * (time.monotonic() - start_s)))
        except Exception:  # the sweep goes on, unseen
            log.info("the display of the sweep has ended", exc_info=True)

    def _read(self, anew: bool) -> Snapshot | None:
        """How the sweep stands, read anew or with what its running jobs say; None if it cannot be read now."""
        start_s = time.monotonic()
        try:
            sweep = self._load() if anew or self._seen is None else self._seen.sweep
        except (OmnilabError, OSError):
            return None
        seen = self._seen = snapshot(sweep)
        if anew:
            self._next_s = time.monotonic() + SHARE * (time.monotonic() - start_s)
        states = {job.number: job.state for job in sweep.jobs}
        if self._states is None:  # what was before is none of our news
            self._states = states
        return seen

    def _show(self, seen: Snapshot) -> None:
        assert self._states is not None
        news = [job for job in seen.sweep.jobs if job.state != self._states.get(job.number, PLANNED)]
        self._states |= {job.number: job.state for job in news}
        self._changed |= {job.number for job in news}
        if self._serial:
            Console.heading = overall(seen)
        elif (live := self._live) is not None:
            live.update(board(seen, live.console), refresh=True)
        elif self._speaks:
            _say(seen, [job for job in news if job.state != PLANNED])

    def _say_bad(self) -> None:
        """A line for each job that ended badly, which the table is no more there to show."""
        if self._seen is not None:
            bad = [job for job in self._seen.of(*BAD) if job.number in self._changed]
            _say(self._seen, sorted(bad[:MOST_LINES], key=lambda job: job.number))
            if (more := len(bad) - MOST_LINES) > 0:
                print_error(f"{more} more jobs ended so")


def _say(seen: Snapshot, jobs: list[Job]) -> None:
    for job in jobs:
        print_error(what_happened(seen, job))
