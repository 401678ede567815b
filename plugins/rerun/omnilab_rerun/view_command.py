"""Command `omnilab view`: a run's recording in the Rerun viewer, or a screenshot of it without a display."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from omnilab.hooks import Runs
from omnilab_rerun.sink import RerunSink

LATEST, STATUS = Path("logs/latest"), "status.json"
CONCLUDED = ("done", "failed", "interrupted")  # states of which the recording itself tells


def view(runs: Runs, argv: Sequence[str]) -> int:
    """Open a run's recording in Rerun, or those of several side by side, or take a picture of it without a display."""
    options = _parser().parse_args(argv)
    folders = [folder for given in options.run or [LATEST] for folder in jobs_of(given)]
    with _ended_in_good_order():
        if options.save is not None:
            from omnilab_rerun.several import save_several

            save_several(runs, folders, options.save)
        elif len(folders) == 1:
            ready, now = runs.ready(folders[0]), runs.summary(folders[0])
            header = "" if now.state in CONCLUDED else now.header
            RerunSink().view(ready, screenshot=options.screenshot, step=options.step, header=header)
        else:
            from omnilab_rerun.several import view_several

            view_several(runs, folders, options.screenshot, options.step)
    if options.save is not None:
        sys.stderr.write(f"omnilab: the merged recording is {options.save}\n")
    if options.screenshot is not None:
        sys.stderr.write(f"omnilab: the picture is {options.screenshot}\n")
    return 0


def jobs_of(folder: Path) -> list[Path]:
    """The runs of a sweep's jobs, by their numbers, without earlier attempts; any other folder is itself."""
    if (folder / STATUS).exists() or not folder.is_dir():
        return [folder]
    jobs = [job for job in folder.iterdir() if job.name.isdecimal() and (job / STATUS).is_file()]
    return sorted(jobs, key=lambda job: int(job.name)) or [folder]


@contextmanager
def _ended_in_good_order() -> Iterator[None]:
    """Signals end what they interrupt as Ctrl-C does: with the viewer, and with the copy of a run that is shown."""

    def end(number: int, _: object) -> None:
        raise SystemExit(128 + number)

    before = {number: signal.signal(number, end) for number in (signal.SIGTERM, signal.SIGHUP)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("omnilab view", description=view.__doc__)
    add = parser.add_argument
    add("run", nargs="*", type=Path, help="run folders, or a sweep's for all its jobs (default: the latest run)")
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--save", type=Path, metavar="FILE.rrd", help="write the runs side by side as this recording")
    how.add_argument("--screenshot", type=Path, metavar="FILE.png", help="write this PNG instead of opening a window")
    add("--step", type=int, help="the step to show in the picture (default: the last)")
    return parser
