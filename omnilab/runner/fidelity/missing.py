"""Runs what is missing for claims: ordinary runs, each in a process of its own, cheapest first."""

from __future__ import annotations

import shlex
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from omnilab.runner.fidelity.claims import ClaimRun
from omnilab.runner.run_folder import DONE, find_runs
from omnilab.runner.terminal import print_error

WITHOUT_RECORDINGS = ("~sink@sinks.rerun", "~sink@sinks.mcap")  # the table needs none; they change no result
LAST_LINES = 20  # of a run that fails, in which its sentence is looked for


@dataclass(frozen=True)
class MissingRun:
    """One run with one seed that claims need."""

    run: ClaimRun
    seed: int

    @property
    def words(self) -> list[str]:
        return [*self.run.words, f"seed={self.seed}"]

    @property
    def title(self) -> str:
        return f"{self.run.name}, seed {self.seed}"


class RunningChildren:
    """Processes of ours, which an interrupt ends in order."""

    def __init__(self) -> None:
        self._lock, self._running, self._interrupted = threading.Lock(), set[subprocess.Popen[str]](), False

    def run(self, module: Sequence[str]) -> tuple[int, str]:
        """Run a Python module with arguments; its exit code, and what it printed on standard error.

        In a session of its own: a Ctrl-C at the terminal reaches it once, by `interrupt`.
        """
        with self._lock:
            if self._interrupted:
                return -signal.SIGINT, ""
            child = subprocess.Popen(
                [sys.executable, "-m", *module],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
                start_new_session=True,
            )
            self._running.add(child)
        printed = child.communicate()[1]
        with self._lock:
            self._running.discard(child)
        return child.returncode, printed

    def interrupt(self) -> None:
        """End those that run, and begin no other."""
        with self._lock:
            self._interrupted = True
            for child in self._running:
                child.send_signal(signal.SIGINT)


def run_missing(missing: Sequence[MissingRun], logs: Path, jobs: int) -> list[MissingRun]:
    """Run them, so many at once, and say of each how it ended; those that failed. The others go on."""
    started, children = time.monotonic(), RunningChildren()

    def one(numbered: tuple[int, MissingRun]) -> bool:
        number, each = numbered
        print_error(f"{number} of {len(missing)}: {each.title}: omnilab {shlex.join(each.words)}")
        begun = time.monotonic()
        sentence = _execute(each, logs, children)
        print_error(f"{each.title}: {sentence or 'done'} ({_minutes_since(begun)} min)")
        return not sentence

    with ThreadPoolExecutor(jobs) as pool:
        try:
            done = list(pool.map(one, enumerate(missing, 1)))
        except BaseException:  # Ctrl-C: runs end in order, and those that wait are not begun
            pool.shutdown(wait=False, cancel_futures=True)
            children.interrupt()
            raise
    failed = [each for each, well in zip(missing, done, strict=True) if not well]
    print_error(f"{len(missing) - len(failed)} runs done, {len(failed)} failed, in {_minutes_since(started)} min")
    return failed


def _minutes_since(start_s: float) -> str:
    return f"{(time.monotonic() - start_s) / 60:.1f}"


def _execute(missing: MissingRun, logs: Path, children: RunningChildren) -> str:
    """Run it; the sentence with which it failed, or nothing."""
    code, printed = children.run(["omnilab", *missing.words, *WITHOUT_RECORDINGS, f"logs={logs}"])
    if code == 0:
        return ""
    lines = [line for line in printed.splitlines()[-LAST_LINES:] if line.strip()]
    sentences = [line.removeprefix("omnilab: ") for line in lines if line.startswith("omnilab: ")]
    return f"failed, {(sentences or lines or [f'exit code {code}'])[-1]}"


def going_on(logs: Path) -> list[str]:
    """Runs below a folder that go on, or may: another process has begun them."""
    if not logs.is_dir():
        return []
    return [str(run.folder) for run in find_runs(logs) if run.status.get("status") != DONE and run.alive]
