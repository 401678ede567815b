"""`omnilab submit`, and `omnilab runs --server`: what `omnilab serve` does elsewhere."""

from __future__ import annotations

import argparse
import math
import sys

from omnilab.client import Client, RunRecord, Submission, SubmissionRequest
from omnilab.errors import DataError
from omnilab.runner.remote.options import add_server
from omnilab.runner.terminal import headline, print_error

EXIT_CODES = {"done": 0, "failed": 1, "interrupted": 130, "cancelled": 130, "killed": 137}
PAGE = 1000  # runs in one answer


def submit(argv: list[str]) -> int:
    """Put an experiment into the queue of a server: a run, or with comma-separated values a sweep."""
    parser = argparse.ArgumentParser("omnilab submit", description=submit.__doc__)
    parser.add_argument("overrides", nargs="+", metavar="OVERRIDE", help="as of omnilab, with experiment=NAME")
    parser.add_argument("--priority", type=int, default=0, help="the larger, the sooner (default: 0)")
    parser.add_argument("--launcher", default="basic", metavar="NAME", help="of a sweep's jobs (default: basic)")
    parser.add_argument("--wait", action="store_true", help="until it has ended; the exit code says how")
    add_server(parser)
    options = parser.parse_intermixed_args(argv)
    client = Client(options.server, options.token)
    found = client.submit(SubmissionRequest(options.overrides, options.priority, options.launcher))
    sys.stdout.write(f"{found.id} {client.url}/queue/{found.id}\n")
    sys.stdout.flush()
    return wait(client, found.id) if options.wait else 0


def wait(client: Client, identity: str) -> int:
    """Show how a submission gets on until it has ended; the exit code that says how."""
    shown = ""

    def show(submission: Submission) -> None:
        nonlocal shown
        words = progress_words(client, submission)
        if words != shown:
            print_error(words)
        shown = words

    try:
        found = client.wait(identity, watch=show)
    except KeyboardInterrupt:
        print_error(f"no longer waiting; {identity} goes on at {client.url}/queue/{identity}")
        return 130
    print_error(": ".join(filter(None, [f"{found.path or identity} {found.state}", found.error])))
    return EXIT_CODES[found.state]


def progress_words(client: Client, submission: Submission) -> str:
    """As "running, 43 % (queries 86 of 200)"."""
    if submission.path is None or submission.state != "running":
        return submission.state
    try:
        if submission.sweep:
            counts = client.sweep(submission.path).counts
            return f"running, jobs: {', '.join(f'{count} {state}' for state, count in counts.items() if count)}"
        progress = client.run(submission.path).progress
    except DataError:  # its folder is not there yet
        return submission.state
    return f"running, {progress.words}" if progress else submission.state


def run_rows(url: str | None, token: str | None) -> list[list[str]]:
    """The runs of a server, as rows of the table of `omnilab runs`."""
    client = Client(url, token)
    found: list[RunRecord] = []
    while len(found) < (page := client.runs(sort="started", offset=len(found), limit=PAGE)).total and page.runs:
        found += page.runs
    return [_row(run) for run in sorted(found, key=lambda run: run.path)]


def _row(run: RunRecord) -> list[str]:
    metrics = {name: math.nan if value is None else value for name, value in run.metrics.items()}
    state = f"{run.state} {run.progress.words}" if run.progress else run.state
    return [run.path, state, headline(metrics) or run.error or "", " ".join(run.overrides)]
