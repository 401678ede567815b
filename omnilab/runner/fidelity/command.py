"""The command `omnilab fidelity`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from omnilab.atomic_files import write_whole
from omnilab.errors import ConfigError, DataError
from omnilab.runner.discovery import discover_loudly
from omnilab.runner.fidelity.claims import ClaimRun, ClaimSet, shipped_claims
from omnilab.runner.fidelity.document import document, results
from omnilab.runner.fidelity.kept import merged, read_kept, write_kept
from omnilab.runner.fidelity.matching import RunMatcher
from omnilab.runner.fidelity.missing import MissingRun, going_on, run_missing
from omnilab.runner.interrupts import uninterrupted
from omnilab.runner.run_folder import find_runs
from omnilab.runner.terminal import print_error, print_table

LOGS = Path("logs/fidelity")
HELP = "what the publications behind the recipes claim, measured: run what is missing, and write the table"


def fidelity(argv: list[str]) -> int:
    """Measure what the publications claim."""
    options = _parser().parse_args(argv)
    everything = shipped_claims()
    claims = everything.selected(options.claims)
    if options.command == "list":
        _print_claims(claims)
        return 0
    with uninterrupted():
        matcher = RunMatcher(claims.needed(), everything.quantities(), discover_loudly())
    for name, problem in matcher.problems.items():
        print_error(f"the run '{name}' of the claims cannot be composed: {problem}")
    code = _run(claims, matcher, options) if options.command == "run" else _report(claims, matcher, options)
    return code or int(bool(matcher.problems))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("omnilab fidelity", description=HELP)
    commands = parser.add_subparsers(dest="command", required=True)
    listing = commands.add_parser("list", help="the claims, and the runs that they need")
    run = commands.add_parser("run", help="run what is missing, cheapest first; again: what is still missing")
    report = commands.add_parser("report", help="write the table from run folders")
    for each in (listing, run, report):
        each.add_argument(
            "--claims", default="*", metavar="PATTERN", help="those whose id or chapter is like this (default: all)"
        )
    run.add_argument("--logs", type=Path, default=LOGS, metavar="DIR", help=f"where the runs go (default: {LOGS})")
    run.add_argument("--seeds", type=_count, default=1, metavar="N", help="seeds 0 to N - 1 of each run (default: 1)")
    run.add_argument("--jobs", type=_count, default=1, metavar="N", help="runs at a time (default: 1)")
    run.add_argument(
        "--minutes", type=float, default=None, metavar="M", help="leave out runs that take longer, about, on one core"
    )
    report.add_argument("folders", nargs="*", type=Path, metavar="FOLDER", help="a folder of runs, at any depth")
    report.add_argument(
        "-o", "--output", type=Path, default=Path("fidelity.md"), metavar="FILE", help="(default: fidelity.md)"
    )
    keeps = "a JSON file of measurements whose folders may be gone: read beside the folders"
    run.add_argument("--keep", type=Path, metavar="FILE", help=f"{keeps}; what it has is not missing")
    report.add_argument("--keep", type=Path, metavar="FILE", help=f"{keeps}, and written with what these have")
    return parser


def _count(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= 1000:
        raise argparse.ArgumentTypeError(f"{text} is no number of 1 to 1000")
    return int(text)


def _print_claims(claims: ClaimSet) -> None:
    rows = [
        [chapter.name, claim.id, claim.reported, claim.expect.words if claim.expect else "", ", ".join(claim.runs)]
        for chapter in claims.chapters
        for claim in chapter.claims
    ]
    print_table(["chapter", "claim", "reported", "holds if", "runs"], rows)
    needed = [[run.name, f"{run.minutes:g}", " ".join(["omnilab", *run.words])] for run in claims.needed()]
    print_table(["run", "minutes", "command"], needed)


def _run(claims: ClaimSet, matcher: RunMatcher, options: argparse.Namespace) -> int:
    """Run what is missing; 1 if a run failed."""
    logs: Path = options.logs
    kept = read_kept(options.keep) if options.keep else {}
    done, _, _ = matcher.found([logs] if logs.is_dir() and find_runs(logs) else [], kept)
    if active := going_on(logs):
        raise ConfigError(f"{active[0]} is being written by another process; wait for it, or give another --logs")
    wanted = [run for run in claims.needed() if run.name not in matcher.problems]
    chosen = [run for run in wanted if options.minutes is None or run.minutes <= options.minutes]
    missing = _missing(chosen, {name: {run.seed for run in runs} for name, runs in done.items()}, options.seeds)
    if left := len(wanted) - len(chosen):
        print_error(f"{left} runs of more than {options.minutes:g} min are left out")
    if not missing:
        keep = f" --keep {options.keep}" if options.keep else ""
        print_error(f"nothing is missing; the table: omnilab fidelity report {logs}{keep}")
        return 0
    return 1 if run_missing(missing, logs, options.jobs) else 0


def _missing(runs: Sequence[ClaimRun], done: dict[str, set[str]], seeds: int) -> list[MissingRun]:
    """Each run with its first seed, then each with its second: the table is whole as early as can be."""
    return [
        MissingRun(run, seed) for seed in range(seeds) for run in runs if str(seed) not in done.get(run.name, set())
    ]


def _report(claims: ClaimSet, matcher: RunMatcher, options: argparse.Namespace) -> int:
    keep: Path | None = options.keep
    if not options.folders and keep is None:
        raise ConfigError("there is nothing to report from; give a folder of runs, or --keep FILE")
    kept = read_kept(keep) if keep else {}
    found, left_out, others = matcher.found(options.folders, kept)
    notes = [f"{name} cannot be composed: {problem}" for name, problem in matcher.problems.items()]
    notes += [f"{others} runs in the folders are of no claim"] if others else []
    notes += [f"{name} was kept, and is no run of a claim" for name in kept if name not in claims.runs]
    _write(options.output, document(claims, found, left_out, notes))
    if keep:
        write_kept(keep, merged(kept, found))
    counts: dict[str, int] = {}
    for each in (result for chapter in results(claims, found).values() for result in chapter):
        counts[each.verdict] = counts.get(each.verdict, 0) + 1
    print_error(f"{options.output}: " + ", ".join(f"{count} {verdict}" for verdict, count in counts.items()))
    return 0


def _write(output: Path, text: str) -> None:
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
        write_whole(output, lambda file: file.write(text.encode()))
    except OSError as error:
        raise DataError(f"{output} cannot be written ({error.strerror}); give another place") from error
