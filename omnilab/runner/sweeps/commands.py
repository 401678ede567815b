"""The command `omnilab sweep`: go on with a sweep, watch it, list those there are."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from omnilab.errors import ConfigError, DataError
from omnilab.runner.discovery import discover_loudly
from omnilab.runner.overrides.doubts import doubt
from omnilab.runner.registry import Registry
from omnilab.runner.sweeps.plan_file import PLAN, SweepPlan, read_plan
from omnilab.runner.sweeps.start import RESUME, RETRY
from omnilab.runner.sweeps.status_commands import list_arguments, list_sweeps, status, status_arguments
from omnilab.runner.terminal import print_error


def sweep(argv: list[str]) -> int:
    """Go on with a sweep, watch it, or list the sweeps there are."""
    parser = argparse.ArgumentParser("omnilab sweep", description=sweep.__doc__)
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    for name, (command, add_arguments) in COMMANDS.items():
        sub = commands.add_parser(name, help=command.__doc__, description=command.__doc__)
        add_arguments(sub)
        sub.set_defaults(command=command)
    options = parser.parse_args(argv)
    return int(options.command(options))


def _resume_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("sweep", type=Path, metavar="SWEEP", help="the sweep's folder")
    parser.add_argument("--retry-failed", action="store_true", help="run the jobs that failed once more, too")
    parser.add_argument(
        "--trust",
        action="store_true",
        help="do as the sweep's file says, also where that could read, run or replace anything",
    )


def resume(options: argparse.Namespace) -> int:
    """Run what is missing, was cut off or killed; jobs that are done are taken over."""
    from omnilab.runner.hydra_app import experiment

    plan = read_plan(options.sweep)
    if plan is None:
        raise DataError(f"{options.sweep} holds no sweep that could go on (no {PLAN}); run its command again")
    registry = discover_loudly()
    words = checked_words(plan, options.sweep, options.trust, registry)
    print_error(f"the sweep goes on: omnilab {shlex.join(words)}")
    words += [f"{RESUME}={options.sweep.absolute()}", *([f"{RETRY}=on"] if options.retry_failed else [])]
    return experiment(words, registry)


def checked_words(plan: SweepPlan, folder: Path, trust: bool, registry: Registry) -> list[str]:
    """The words of a sweep's command; an error if they were meant for another folder, or might be a stranger's."""
    there = Path(plan.directory)
    if there.is_dir() and not there.samefile(Path.cwd()):
        where = shlex.quote(plan.directory)
        raise ConfigError(f"the sweep was begun in {where}, from where its files are named; go there first: cd {where}")
    for word in plan.command if not trust else ():
        if reason := doubt(word, registry):
            raise DataError(f"{folder / PLAN} has {word}, {reason}; if that file is your own, give --trust")
    return list(plan.command)


COMMANDS = {
    "resume": (resume, _resume_arguments),
    "status": (status, status_arguments),
    "list": (list_sweeps, list_arguments),
}
