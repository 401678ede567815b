"""The command `omnilab compare`."""

from __future__ import annotations

import argparse
import gc
import json
import shlex
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from omnilab.errors import DataError, visible
from omnilab.runner.interrupts import uninterrupted
from omnilab.runner.terminal import HEADLINE, print_error, print_table, short

if TYPE_CHECKING:
    from pandas import DataFrame

    from omnilab.runner.compare.comparison import RunComparison

BESIDE = 4  # configurations that are shown side by side; more are rows
HELP = (
    "compare runs and sweeps: what differs between their configurations, and their metrics, over seeds, query by query"
)


def compare(argv: list[str]) -> int:
    """Compare runs and sweeps."""
    options = _parser().parse_args(_joined(argv))
    with uninterrupted():
        from omnilab.runner.compare.comparison import compare_runs
        from omnilab.runner.compare.order import best_first, by_setting, checked

    with _without_collection():
        comparison = compare_runs(options.folders)
        if options.by:
            comparison = by_setting(comparison, options.by)
        if options.best:
            comparison = best_first(comparison, options.best)
    metrics = options.metrics or _main_metrics(comparison, options.best)
    checked(metrics, comparison.metrics, "metric of these runs")
    if options.json:
        _print_json(comparison)
    else:
        _show(comparison, metrics, options)
    try:
        _write(comparison, metrics, options)
    except OSError as error:
        raise DataError(f"{error.filename} cannot be written ({error.strerror}); give another place") from error
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("omnilab compare", description=HELP)
    add = parser.add_argument
    add(
        "folders",
        nargs="+",
        type=Path,
        metavar="RUN|SWEEP",
        help="folders of runs, and of sweeps or others with runs in them",
    )
    add("--by", metavar="SETTING", help="by the values of a setting that differs, the others held fixed")
    add("--best", metavar="METRIC", help="by a metric, the smallest value first; -METRIC: the largest")
    add(
        "--metrics",
        type=lambda text: text.split(","),
        metavar="A,B",
        help="which metrics (default: all, or the main ones)",
    )
    add("--json", action="store_true", help="print all that is known of them as one JSON document")
    add("--csv", type=Path, metavar="FILE", help="write all statistics of all metrics, a row each (replaces FILE)")
    add("--latex", type=Path, metavar="FILE", help="write the table of configurations for LaTeX (booktabs)")
    add("--markdown", type=Path, metavar="FILE", help="the same for Markdown")
    add(
        "--figures",
        type=Path,
        metavar="DIR",
        help="draw the metrics over what differs, and over what they cost, as PNG",
    )
    return parser


def _joined(argv: Sequence[str]) -> list[str]:
    """`--best -METRIC` in one word, which argparse would take for two options."""
    words = list(argv)
    for i, word in enumerate(words[:-1]):
        if word == "--best":
            words[i : i + 2] = [f"--best={words[i + 1]}"]
            break
    return words


@contextmanager
def _without_collection() -> Iterator[None]:
    """Ten thousand runs are no garbage, and to look for some among them takes a second."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


def _main_metrics(comparison: RunComparison, objective: str | None) -> list[str]:
    """The one that is asked for, and the study's first."""
    asked_for = [objective.removeprefix("-")] if objective else []
    return list(dict.fromkeys(asked_for + comparison.metrics))[:HEADLINE]


def _print_json(comparison: RunComparison) -> None:
    with uninterrupted():
        from omnilab.runner.compare.document import comparison_document

        document = comparison_document(comparison)
    sys.stdout.write(json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n")


def _show(comparison: RunComparison, metrics: Sequence[str], options: argparse.Namespace) -> None:
    """The tables of a comparison, and what is to be known of them."""
    from omnilab.runner.compare import tables
    from omnilab.runner.compare.paired import paired_errors

    with uninterrupted():
        pairs, more = paired_errors(comparison)
    if len(comparison.groups) > BESIDE or options.by or options.best:
        _print(tables.group_table(comparison, metrics))
    else:
        _print(tables.configuration_table(comparison))
        _print(tables.metric_table(comparison, options.metrics or comparison.metrics))
    if pairs:
        _print(tables.paired_table(pairs), "query by query")
    if comparison.left_out:
        rows = [[run.name, run.state, run.why] for run in comparison.left_out]
        print_table(["left out", "status", "why"], rows)
        sys.stdout.write("\n")
    sentences = [*comparison.notes, *more, *tables.meanings(comparison, pairs)]
    if options.best:
        sentences.append(_best(comparison, options.best))
    for sentence in sentences:
        sys.stdout.write(visible(f"{sentence}.") + "\n")


def _best(comparison: RunComparison, objective: str) -> str:
    """Which configuration is the best, and how to run it again."""
    from omnilab.runner.compare.tables import NOTHING

    best = comparison.groups.iloc[0]
    settings = " ".join(f"{name}={value}" for name, value in best.items() if value not in {None, NOTHING})
    folder = comparison.runs.loc[comparison.runs["group"] == 0, "folder"].iloc[0]
    metric = objective.removeprefix("-")
    first, other = ("largest", metric) if objective.startswith("-") else ("smallest", f"-{metric}")
    return (
        f"the {first} {metric} is first (--best={other}: the other way round): {settings or 'the only configuration'};"
        f" again: omnilab repeat {shlex.quote(str(short(folder)))}"
    )


def _print(table: DataFrame, title: str = "") -> None:
    print_table(list(table.columns), table.to_numpy().tolist(), title)
    sys.stdout.write("\n")


def _write(comparison: RunComparison, metrics: Sequence[str], options: argparse.Namespace) -> None:
    """The files that are asked for."""
    from omnilab.runner.compare import tables

    written = []
    if options.csv:
        tables.write_csv(comparison, _target(options.csv))
        written.append(options.csv)
    for file, write in (options.latex, tables.write_latex), (options.markdown, tables.write_markdown):
        if file:
            write(tables.group_table(comparison, metrics), _target(file))
            written.append(file)
    if options.figures:
        from omnilab.runner.compare.figures import draw

        written += draw(comparison, options.metrics or metrics[:1], options.figures, options.best)
    for file in written:
        print_error(f"written: {file}")


def _target(file: Path) -> Path:
    """Where a file that is asked for lies; DataError for a device, a pipe or a folder, whose place it must not take."""
    path = file.resolve()
    if path.exists() and not path.is_file():
        raise DataError(f"{file} is no file that could be replaced; give the name of one, or of none that is there")
    return path
