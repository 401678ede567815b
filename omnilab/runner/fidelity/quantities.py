"""What a claim is about: a metric of a run, a cell of one of its tables, or a quotient of two of these."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from omnilab.errors import ConfigError, DataError
from omnilab.runner.compare.gathering import ComparedRun
from omnilab.runner.fidelity.measured import MeasuredValue
from omnilab.runner.run_folder import load_run

CELL = re.compile(r"(?P<table>[\w-]+)\.csv(\[(?P<where>[^\]]+)\])?\.(?P<column>\w+)")
OF_COLUMN = re.compile(r"(?P<statistic>\w+)\((?P<cell>.+)\)")
STATISTICS: dict[str, Callable[[Sequence[float]], float]] = {
    "mean": lambda values: math.fsum(values) / len(values),
    "min": min,
    "max": max,
}
METRIC = re.compile(r"[^\s\[\]/]+")
OVER = " / "
UNITS = {"m", "s", "ms", "deg", "steps"}  # with which names of columns end


@dataclass(frozen=True)
class MetricTerm:
    """A metric; or a cell of a table, the column of the row in which other columns have given values; or a statistic of
    a column over such rows."""

    run: str
    name: str  # of the metric, or the column
    table: str = ""
    where: tuple[tuple[str, str], ...] = ()
    statistic: str = ""

    def measured(self, run: ComparedRun) -> MeasuredValue:
        """In one run folder; NaN where it has no value. DataError if it was not measured."""
        if self.table:
            return self._of_table(run)
        if self.name not in run.metrics:
            raise DataError(f"{run.folder} has no metric {self.name}; run it again")
        low, high = run.intervals.get(self.name, (None, None))
        unit = run.units.get(self.name, "")
        return MeasuredValue(float(run.metrics[self.name]), low, high, "" if unit == "1" else unit)

    def _of_table(self, run: ComparedRun) -> MeasuredValue:
        """Of a cell with the interval of the columns COLUMN_low and COLUMN_high, or of a statistic."""
        rows = self._rows(run)
        values = [self._number(run, row, self.name) for row in rows]
        unit = self.name.rpartition("_")[2]
        unit = unit if unit in UNITS else ""
        if self.statistic:
            return MeasuredValue(STATISTICS[self.statistic](values), unit=unit)
        low, high = f"{self.name}_low", f"{self.name}_high"
        if low not in rows[0] or high not in rows[0]:
            return MeasuredValue(values[0], unit=unit)
        return MeasuredValue(values[0], self._number(run, rows[0], low), self._number(run, rows[0], high), unit)

    def _rows(self, run: ComparedRun) -> list[dict[str, str]]:
        """The row of a cell, or those of a statistic; DataError if there are none, or too many."""
        rows = [row for row in load_run(run.folder).table(self.table) if self._fits(row)]
        if not rows or (len(rows) > 1 and not self.statistic) or self.name not in rows[0]:
            conditions = " and ".join(map("=".join, self.where)) or "anything"
            raise DataError(
                f"{run.folder}/{self.table}.csv has {len(rows)} rows with {conditions}, and a column {self.name} is"
                " wanted of one: correct the claim, or run it again"
            )
        return rows

    def _number(self, run: ComparedRun, row: Mapping[str, str], column: str) -> float:
        try:
            return float(row[column] or math.nan)
        except ValueError as error:
            raise DataError(f"{run.folder}/{self.table}.csv: {column} is no number ({error}); run it again") from error

    def _fits(self, row: Mapping[str, str]) -> bool:
        return all(row.get(column) == value for column, value in self.where)


@dataclass(frozen=True)
class Quantity:
    """A term, or one over another, `A / B`, of the same run."""

    text: str
    term: MetricTerm
    over: MetricTerm | None = None

    @property
    def terms(self) -> list[MetricTerm]:
        return [self.term, self.over] if self.over else [self.term]

    @property
    def runs(self) -> list[str]:
        return [self.term.run]

    @property
    def metrics(self) -> list[str]:
        """The names of the metrics in it."""
        return [term.name for term in self.terms if not term.table]

    @property
    def is_time(self) -> bool:
        """Of itself, or of what it is a quotient of."""
        return all(term.name.endswith(("_ms", "_s")) for term in self.terms)

    def measured(self, run: ComparedRun) -> MeasuredValue:
        """In one run folder; DataError if it was not measured. A quotient has no unit, and no interval."""
        value = self.term.measured(run)
        if self.over is None:
            return value
        return MeasuredValue(_quotient(value.value, self.over.measured(run).value))


def parsed_quantity(text: str, run: str) -> Quantity:
    """Of `METRIC`, `TABLE.csv[COLUMN=VALUE,...].COLUMN`, `mean(TABLE.csv.COLUMN)`, or two of these with ` / ` between.

    ConfigError otherwise.
    """
    if not run:
        raise ConfigError(f"the metric '{text}' is of no run; say `run` beside it")
    first, *others = (_term(part.strip(), run) for part in text.split(OVER))
    if len(others) > 1:
        raise ConfigError(f"'{text}' has more than one quotient; give METRIC / METRIC")
    return Quantity(text, first, others[0] if others else None)


def _term(text: str, run: str) -> MetricTerm:
    if (of := OF_COLUMN.fullmatch(text)) and of["statistic"] in STATISTICS:
        return replace(_term(of["cell"], run), statistic=of["statistic"])
    if found := CELL.fullmatch(text):
        pairs = [pair.strip().partition("=") for pair in (found["where"] or "").split(",") if pair.strip()]
        return MetricTerm(run, found["column"], found["table"], tuple((name, value) for name, _, value in pairs))
    if not METRIC.fullmatch(text):
        raise ConfigError(
            f"'{text}' is no metric; give its name, or TABLE.csv[COLUMN=VALUE].COLUMN for a cell of a table"
        )
    return MetricTerm(run, text)


def _quotient(value: float, over: float) -> float:
    return value / over if over else math.nan
