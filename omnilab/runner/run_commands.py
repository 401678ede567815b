"""The commands on runs: list them, run one again, mend the logs of one."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from omnilab.errors import ConfigError, DataError
from omnilab.runner.discovery import discover_loudly
from omnilab.runner.remote.options import add_server
from omnilab.runner.repair import mend, mend_copy
from omnilab.runner.run_folder import RUNNING, UNREADABLE, LoadedRun, find_runs, load_run, new_folder_name
from omnilab.runner.terminal import headline, print_error, print_table, short, show_run

LIMITS_OFF = "limits=off"


def runs(argv: list[str]) -> int:
    """List the runs there are, with their status and main metrics."""
    parser = argparse.ArgumentParser("omnilab runs", description=runs.__doc__)
    parser.add_argument("logs", nargs="?", type=Path, help="where to look (default: logs)")
    add_server(parser)
    options = parser.parse_args(argv)
    if options.server and options.logs:
        raise ConfigError(
            f"give either a folder ({options.logs}) or a server ({options.server}); they have runs of their own"
        )
    if options.server:
        from omnilab.runner.remote.commands import run_rows  # and the network

        rows = run_rows(options.server, options.token)
    else:
        rows = _local_rows(options.logs or Path("logs"))
    print_table(["run", "status", "main metrics", "overrides"], rows)
    return 0


def _local_rows(logs: Path) -> list[list[str]]:
    found, rows = find_runs(logs)[::-1], []
    while found:
        rows.append(_described(found.pop(), logs))  # and what was read of it is let go
    return rows


def _described(run: LoadedRun, logs: Path) -> list[str]:
    """Name, status, main metrics, overrides; a damaged run must not hide the others."""
    name = str(run.folder).removeprefix(f"{logs}/")
    try:
        overrides = [override for override in run.manifest["overrides"] if override[:11] != "experiment="]
        return [name, _state(run), headline(run.metrics), " ".join(overrides)]
    except DataError as error:
        return [name, UNREADABLE, str(error), ""]


def _state(run: LoadedRun) -> str:
    """As "running 43 % (queries 86 of 200)"."""
    state = run.state
    progress = run.progress if state == RUNNING else None
    return f"{state} {progress.words}".rstrip() if progress else state


def repeat(argv: list[str]) -> int:
    """Run a run's configuration and seed again, and say whether the metrics are the same (exit code 1 if not)."""
    parser = _run_parser("omnilab repeat", repeat.__doc__)
    parser.add_argument("--logs", default="logs", metavar="DIR", help="where the new run goes (default: logs)")
    parser.add_argument(
        "--trust",
        action="store_true",
        help="open files and folders that the run names though they are not those it read",
    )
    parser.epilog = f"{LIMITS_OFF}, as for an experiment: try what the machine may be too small for"
    options = parser.parse_args([word for word in argv if word != LIMITS_OFF])
    first = load_run(options.run)
    name = _repeatable(first, options.run)
    second = _run_again(first, name, options.logs, options.trust, LIMITS_OFF not in argv)
    return _compare(first, second)


def _repeatable(run: LoadedRun, given: Path) -> str:
    """The experiment of a run that can be repeated; DataError for one that cannot."""
    if "components" not in run.manifest:
        raise DataError(f"{given} could not be built, so there is nothing to repeat: {run.status.get('error')}")
    if not run.metrics:
        raise DataError(f"{given} did not finish ({run.state}), so there is nothing to compare with; run it anew")
    name = str(run.manifest["experiment"])
    if not re.fullmatch(r"[\w-]+(/[\w-]+)*", name):
        raise DataError(f"{run.folder / 'manifest.json'} names the experiment '{name}', which is no name; correct it")
    return name


def _run_again(first: LoadedRun, name: str, logs: str, trust: bool, limits: bool) -> LoadedRun:
    """A new run of the same configuration; where it writes, and what it may take, is never as a file says."""
    from omnilab.runner.build import again
    from omnilab.runner.config import Settings, logs_folder
    from omnilab.runner.execute import execute

    registry = discover_loudly()
    cache = first.config.get("cache") and Settings.cache
    ours = {"logs": logs, "cache": cache, "cache_gb": Settings.cache_gb, "limits": limits}
    folder = Path(logs_folder(logs)) / name / new_folder_name()
    run = again(first.config | ours, first.manifest, registry, folder, None if trust else _digests(first))
    execute(run, folder, registry, first.manifest["overrides"], name, lambda report: show_run(report, folder))
    return load_run(folder)


def _compare(first: LoadedRun, second: LoadedRun) -> int:
    """Say whether the metrics are the same; the exit code."""
    different = [name for name in first.metrics if repr(first.metrics[name]) != repr(second.metrics.get(name))]
    if different:
        print_error(f"the metrics differ from {short(first.folder)}: {', '.join(different)}")
        return 1
    new = [name for name in second.metrics if name not in first.metrics]  # of a study that has grown since
    more = f"; {', '.join(new)} were not measured then" if new else ""
    print_error(f"the metrics are the same as in {short(first.folder)}, bit for bit{more}")
    return 0


def _digests(run: LoadedRun) -> dict[str, str]:
    """The digests of what a run read, by setting."""
    found = run.manifest.get("files")
    return found if isinstance(found, dict) else {}


def repair(argv: list[str]) -> int:
    """Mend the logs of a run that was killed."""
    parser = _run_parser("omnilab repair", repair.__doc__)
    parser.add_argument(
        "--ended",
        action="store_true",
        help="the run has ended, which cannot be told from here (it is listed as silent: it was on another host)",
    )
    parser.add_argument(
        "--output", type=Path, metavar="DIR", help="leave the run as it is, and mend a copy of it there"
    )
    options = parser.parse_args(argv)
    run = load_run(options.run)
    if options.output is None:
        done = mend(run, discover_loudly(), options.ended)
    else:
        done = [*mend_copy(run, options.output, discover_loudly()), f"the mended copy is {options.output}"]
    for sentence in done or [f"{short(run.folder)} is whole, nothing to repair"]:
        print_error(sentence)
    return 0


def _run_parser(command: str, description: str | None) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(command, description=description)
    parser.add_argument(
        "run", nargs="?", type=Path, default=Path("logs/latest"), help="run folder (default: the latest)"
    )
    return parser
