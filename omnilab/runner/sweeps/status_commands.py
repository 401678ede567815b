"""`omnilab sweep status` and `omnilab sweep list`: how sweeps stand, for people and for programs."""

from __future__ import annotations

import argparse
import json
import os
import shlex
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from omnilab.errors import DataError, visible
from omnilab.runner.run_folder.names import STATUS, SUMMARY, UNREADABLE
from omnilab.runner.sweeps.display import SweepDisplay
from omnilab.runner.sweeps.job_log import JOBS
from omnilab.runner.sweeps.plan_file import PLAN
from omnilab.runner.sweeps.reader import SweepReader
from omnilab.runner.sweeps.snapshot import Snapshot, snapshot
from omnilab.runner.sweeps.state import load_sweep
from omnilab.runner.sweeps.status_table import advice, board, counted, data, duration, state
from omnilab.runner.terminal import print_error, print_table, short

MOST_ROWS = 50  # of jobs, where nobody watches
WIDEST = 1000  # columns, where no person reads


def status_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("sweep", nargs="?", type=Path, metavar="SWEEP", help="its folder (default: the latest)")
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--watch", action="store_true", help="until it ends, or Ctrl-C, which ends the watching alone")
    how.add_argument("--json", action="store_true", help="as data, with every job")


def status(options: argparse.Namespace) -> int:
    """How a sweep stands: its jobs, how far those are that run, what was wrong with others, the time that is left."""
    folder = options.sweep or latest_sweep()
    code = _watch(folder) if options.watch else 0
    seen = snapshot(load_sweep(folder))
    if options.json:
        _print_json(data(seen))
    else:
        _print_status(seen)
    return code


def latest_sweep() -> Path:
    """That of the latest run; DataError if it was none of a sweep's."""
    folder = Path("logs/latest").resolve().parent
    if not any((folder / name).is_file() for name in (JOBS, PLAN)):
        raise DataError("the latest run is no job of a sweep; give the sweep's folder, as omnilab sweep list shows it")
    return folder


def _watch(folder: Path) -> int:
    """Show a sweep while it goes on; the exit code."""
    with SweepDisplay(SweepReader(folder).load, leads=False) as display:
        try:
            while display.goes_on:
                time.sleep(0.2)
        except KeyboardInterrupt:
            return 130
    return 0


def _print_status(seen: Snapshot) -> None:
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=WIDEST)
    console.print(Text(visible(str(short(seen.sweep.folder))), style="bold"), soft_wrap=True)
    if plan := seen.sweep.plan:
        words = (
            f"omnilab {shlex.join(plan.command)}\nbegun {plan.time}, launcher {plan.launcher}, sweeper {plan.sweeper}"
        )
        console.print(*(Text(visible(line)) for line in words.split("\n")), sep="\n", soft_wrap=True)
    console.print()
    console.print(board(seen, console, MOST_ROWS))
    for sentence in advice(seen):
        print_error(sentence)


def list_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("logs", nargs="?", type=Path, default=Path("logs"), help="where to look (default: logs)")
    parser.add_argument("--json", action="store_true", help="as data")


def list_sweeps(options: argparse.Namespace) -> int:
    """List the sweeps there are, how they stand, and what they vary."""
    found = [_summary(folder) for folder in find_sweeps(options.logs)]
    if options.json:
        _print_json(found)
        return 0
    rows = [[str(Path(one["folder"]).relative_to(options.logs.resolve())), *_row(one)] for one in found]
    print_table(["sweep", "status", "jobs", "time left", "varied", "launcher"], rows)
    return 0


def find_sweeps(logs: Path) -> Iterator[Path]:
    """The folders of sweeps below a folder, by name; DataError if there is no such folder. No link is followed."""
    if not logs.is_dir():
        raise DataError(f"there is no folder {logs}; give the one that holds the runs (logs=... of an experiment)")
    waiting = [logs.resolve()]
    while waiting:
        folder = waiting.pop()
        try:
            with os.scandir(folder) as entries:
                inside = list(entries)
        except OSError:
            continue
        names = {entry.name for entry in inside}
        if names & {JOBS, PLAN, SUMMARY}:
            yield folder
        elif STATUS not in names:  # a run holds no sweep
            below = sorted((entry.name for entry in inside if entry.is_dir(follow_symlinks=False)), reverse=True)
            waiting += [folder / name for name in below]


def _summary(folder: Path) -> dict[str, Any]:
    """A sweep as data; one that is damaged hides no other."""
    try:
        seen = snapshot(load_sweep(folder))
    except DataError as error:
        return {"folder": str(folder), "state": UNREADABLE, "error": str(error)}
    plan = seen.sweep.plan
    return {
        "folder": str(folder),
        "state": state(seen),
        "counts": seen.sweep.counts,
        "jobs": counted(seen),
        "left_s": seen.left_s,
        "parameters": plan.parameters if plan else {name: [] for name in seen.parameters},
        "launcher": plan.launcher if plan else None,
        "began": plan.time if plan else None,
        "command": plan.command if plan else None,
    }


def _row(one: dict[str, Any]) -> list[str]:
    if one["state"] == UNREADABLE:
        return [UNREADABLE, one["error"], "", "", ""]
    varied = (f"{name} ({len(values)})" if len(values) > 1 else name for name, values in one["parameters"].items())
    return [one["state"], one["jobs"], duration(one["left_s"]), ", ".join(varied), one["launcher"] or ""]


def _print_json(content: object) -> None:
    sys.stdout.write(json.dumps(content, indent=1, allow_nan=False) + "\n")
