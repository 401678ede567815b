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


def view(runs: Runs, argv: Sequence[str]) -> int:
    """Open a run's recording in Rerun, or take its picture without a display."""
    options = _parser().parse_args(argv)
    with _ended_in_good_order():
        RerunSink().view(runs.ready(options.run), screenshot=options.screenshot, step=options.step)
    if options.screenshot is not None:
        sys.stderr.write(f"omnilab: the picture is {options.screenshot}\n")
    return 0


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
    add("run", nargs="?", type=Path, default=Path("logs/latest"), help="run folder (default: the latest)")
    add("--screenshot", type=Path, metavar="FILE.png", help="write this PNG instead of opening a window")
    add("--step", type=int, help="the step to show in the picture (default: the last with an image)")
    return parser
