"""Tables, errors and results on the terminal."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from omnilab.errors import visible

if TYPE_CHECKING:
    from omnilab.api import Report

HEADLINE = 3  # metrics of a run that fit a line
LONG = 200  # rows of a table that rich lays out in less than a tenth of a second
FIGURE = re.compile(r"-?(0|[1-9]\d*)(\.\d+)?(e[+-]?\d+)?")


def print_error(sentence: str) -> None:
    """One line on standard error."""
    sys.stderr.write(f"omnilab: {visible(sentence)}\n")


def print_table(header: Sequence[str], rows: Sequence[Sequence[str]], title: str = "") -> None:
    """A table on standard output; as wide as it needs to be where no person reads it."""
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    if len(rows) > LONG:
        _print_long(header, rows, title)
        return
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for name in header:
        table.add_column(Text(visible(name)))
    for row in rows:
        table.add_row(*(Text(visible(brief(cell))) for cell in row))  # as text: brackets are no markup
    console = Console()
    if not console.is_terminal:
        console = Console(width=max(80, console.measure(table, options=console.options.update(width=10_000)).maximum))
    if title:
        console.print(Text(visible(title), style="bold"), soft_wrap=True)
    console.print(table)


def _print_long(header: Sequence[str], rows: Sequence[Sequence[str]], title: str) -> None:
    """The same table where rich would take a millisecond a row; its lines are as long as they are."""
    from rich.cells import cell_len

    def width(cell: str) -> int:
        return len(cell) if cell.isascii() else cell_len(cell)

    table = [[visible(cell) for cell in header], *([visible(brief(cell)) for cell in row] for row in rows)]
    widths = [max(map(width, column)) for column in zip(*table, strict=True)]
    lines = [
        "   ".join([cell.ljust(most - width(cell) + len(cell)) for cell, most in zip(row, widths, strict=True)])
        for row in table
    ]
    lines.insert(1, "─" * len("   ".join(" " * most for most in widths)))
    sys.stdout.write("\n".join([*filter(None, [visible(title)]), *lines, ""]))


def brief(cell: str) -> str:
    """Figures with six digits; the files hold them all."""
    return f"{float(cell):.6g}" if FIGURE.fullmatch(cell) else cell


def show_run(report: Report, folder: Path) -> None:
    """The metrics of a run, which are written into its folder next."""
    from omnilab.runner.run_folder import metric_row  # and numpy

    known = [metric_row(metric) for metric in report.metrics]
    rows = [[name, value, unit.replace("1", "", 1)] for name, value, unit, *_ in known]
    header = ["metric", "value", "unit"]
    if any(low for *_, low, _, _ in known):
        header.append("95 % interval")
        intervals = [f"{float(low):.4g} to {float(high):.4g}" if low else "" for *_, low, high, _ in known]
        rows = [[*row, interval] for row, interval in zip(rows, intervals, strict=True)]
    if any(note for *_, note in known):
        header.append("note")
        rows = [[*row, note] for row, (*_, note) in zip(rows, known, strict=True)]
    print_table(header, rows, title=str(short(folder.resolve())))


def headline(metrics: Mapping[str, float]) -> str:
    """A run's first three metrics, in a line."""
    return ", ".join(
        f"{name} {'–' if math.isnan(value) else f'{value:.4g}'}" for name, value in list(metrics.items())[:HEADLINE]
    )


def print_summary(header: Sequence[str], rows: Sequence[Sequence[str]], title: str) -> None:
    """Of a sweep's table, what differs between the jobs: their overrides, and the main metrics. The file holds it all."""
    status = header.index("status")
    differing = [i for i in range(1, status) if len({row[i] for row in rows}) > 1]
    chosen = [0, *differing, *range(status, min(status + 1 + HEADLINE, len(header)))]
    print_table([header[i] for i in chosen], [[row[i] for i in chosen] for row in rows], title)


def short(path: Path) -> Path:
    """Relative to where we are, if it lies below."""
    return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path
