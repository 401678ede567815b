"""Runs what is missing for claims: ordinary runs, each in a process of its own, cheapest first."""

from __future__ import annotations

import shlex
import subprocess
import sys
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


def run_missing(missing: Sequence[MissingRun], logs: Path, jobs: int) -> list[MissingRun]:
    """Run them, so many at once, and say of each how it ended; those that failed. The others go on."""
    started = time.monotonic()

    def one(numbered: tuple[int, MissingRun]) -> bool:
        number, each = numbered
        print_error(f"{number} of {len(missing)}: {each.title}: omnilab {shlex.join(each.words)}")
        begun = time.monotonic()
        sentence = _execute(each, logs)
        minutes = (time.monotonic() - begun) / 60
        print_error(f"{each.title}: {sentence or 'done'} ({minutes:.1f} min)")
        return not sentence

    with ThreadPoolExecutor(jobs) as pool:
        try:
            done = list(pool.map(one, enumerate(missing, 1)))
        except BaseException:  # Ctrl-C: runs have heard it, too; those that wait are not begun
            pool.shutdown(cancel_futures=True)
            raise
    failed = [each for each, well in zip(missing, done, strict=True) if not well]
    minutes = (time.monotonic() - started) / 60
    print_error(f"{len(missing) - len(failed)} runs done, {len(failed)} failed, in {minutes:.1f} min")
    return failed


def _execute(missing: MissingRun, logs: Path) -> str:
    """Run it; the sentence with which it failed, or nothing."""
    command = [sys.executable, "-m", "omnilab", *missing.words, *WITHOUT_RECORDINGS, f"logs={logs}"]
    ended = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False)
    if ended.returncode == 0:
        return ""
    lines = [line for line in ended.stderr.splitlines()[-LAST_LINES:] if line.strip()]
    sentences = [line.removeprefix("omnilab: ") for line in lines if line.startswith("omnilab: ")]
    return f"failed, {(sentences or lines or [f'exit code {ended.returncode}'])[-1]}"


def going_on(logs: Path) -> list[str]:
    """Runs below a folder that go on, or may: another process has begun them."""
    if not logs.is_dir():
        return []
    return [str(run.folder) for run in find_runs(logs) if run.status.get("status") != DONE and run.alive]
