"""View filters against the number of views (Gil et al., 2012, figure 7)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from omnilab.api import Batch, Metric, Parts, Recorder, Report, ViewFilter, check_settings, setting
from omnilab.errors import ConfigError
from omnilab_studies.common.tables import columns_of, markdown
from omnilab_studies.view_slam import figures
from omnilab_studies.view_slam.display import show_drive
from omnilab_studies.view_slam.drives import Drive, Drives
from omnilab_studies.view_slam.filter_comparison import (
    FilterComparison,
    FilterRun,
    batch_of,
    counts,
    evaluated_run,
    runs_of,
    seeds_of,
    selected,
    simulated_filters_of,
)
from omnilab_studies.view_slam.layout import VIEW_MAP
from omnilab_studies.view_slam.scenarios import Scenario, scenario

SUMMARY_COLUMNS = ("views", "filter", "seeds", "rms_m", "worse_m", "final_rms_m", "odometry_rms_m", "nees", "gated")


@dataclass
class ViewCount:
    """Root mean square position error of view filters, and the time of a step, against the number of views.

    Drives are those of the study `view_range`, in one scenario at one range; with more views a seed's drive keeps the
    ones that it had. Times are the medians over steps, their medians over drives: a table and a figure, no metrics, for
    they depend on what else the machine does. `exponent` there is the slope of log time over log N.
    """

    counts: list[int] = setting([2, 4, 8, 16, 32, 64, 100], at_least=1, at_most=10_000, fewest=2)  # of views
    range_m: float = setting(9.0, above=0)  # of observation
    scenario: str = "open"  # a shipped one, or a YAML file
    seeds: int = setting(50, at_least=2, at_most=100_000)  # drives
    fewer_seeds: dict[str, int] = setting({}, at_least=2, at_most=100_000)  # of a slow filter, by its name
    drives: Drives = field(default_factory=Drives)  # laps, noise, mishaps

    needs: ClassVar[tuple[str, ...]] = ()
    metric_names: ClassVar[tuple[str, ...]] = (
        "FILTER_most_rms", "FILTER_most_rms_common", "FILTER_most_nees", "FILTER_fewest_rms",
        "FILTER_fewest_rms_common", "FILTER_fewest_nees", "odometry_rms", "observed", "wrong", "said",
    )  # fmt: skip
    cached: ClassVar[bool] = False  # it measures time
    shard_stages: ClassVar[tuple[str, ...]] = ("drives",)

    def __post_init__(self) -> None:
        check_settings(self, "study.")
        if len(self.counts) < 2 or self.counts != sorted(set(self.counts)) or self.counts[0] < 1:
            raise ConfigError(f"study.counts={self.counts} is no scale; give two or more numbers above 0, ascending")

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Run every filter on the same drives, with ever more views; measure errors and time."""
        filters, base = simulated_filters_of(parts), int(rng.integers(2**32))
        ground = scenario(self.scenario)
        record.log("", VIEW_MAP)
        comparison = FilterComparison(filters, self.seeds, self.fewer_seeds, record, rng)
        times: list[dict[str, Any]] = []
        cases = [(count, name) for count in self.counts for name in filters]
        for (count, name), found in zip(cases, self._runs(cases, ground, base, parts, record), strict=True):
            runs = comparison.add(name, found, {"scenario": ground.name, "views": count}, f"{count} views")
            step_ms = float(np.median([run.step_ms for run in runs]))
            times.append({"views": count, "filter": name, "step_ms": step_ms})
        drive = self.drives.drives(ground, self.counts[-1], base, 1)[0]
        return self._report(comparison, times, filters, drive, ground, record)

    def _runs(
        self, cases: Sequence[tuple[int, str]], ground: Scenario, base: int, parts: Parts, record: Recorder
    ) -> list[list[tuple[FilterRun, list[str]]]]:
        """Of each case, a number of views and a filter, the runs on the drives of its seeds, with warnings."""
        filters = simulated_filters_of(parts)
        order = evenly([seeds_of(name, self.seeds, self.fewer_seeds) for _, name in cases])

        def compute(first: int, last: int) -> Iterator[Batch]:
            for case, seed in record.track(order[first:last], "drive", last - first, lambda _: 1):
                count, name = cases[case]
                (drive,) = self.drives.drives(ground, count, base, 1, seed)
                with record.timed(f"filter: {name}"):
                    run, trace = evaluated_run(filters[name], drive, self.range_m)
                yield batch_of(run, trace.warnings)

        found: list[list[tuple[FilterRun, list[str]]]] = [[] for _ in cases]
        batches = parts.shards.work("drives", len(order), compute)
        for (case, _), run in zip(order, (run for batch in batches for run in runs_of(batch)), strict=True):
            found[case].append(run)
        return found

    def _report(
        self, comparison: FilterComparison, times: Sequence[Mapping[str, Any]], filters: Mapping[str, ViewFilter],
        drive: Drive, ground: Scenario, record: Recorder,
    ) -> Report:  # fmt: skip
        """Metrics, tables, figures; and a drive in the logs, by the first filter."""
        rows, names = comparison.rows, list(filters)
        estimate = show_drive(record, filters[names[0]], drive, ground, self.range_m)
        drawn = {
            "counts": figures.against_count(rows, times, names),
            "nees": figures.consistency(rows, "views", "views N", names),
            "drive": figures.drive(drive, ground, estimate, names[0], self.range_m),
        }
        tables = {
            "counts": columns_of(rows),
            "drives": columns_of(comparison.drive_rows),
            "times": columns_of(with_exponents(times, names)),
        }
        return Report([*_metrics(rows, names), *counts(rows)], tables, drawn, summary=self._summary(rows))

    def _summary(self, rows: Sequence[Mapping[str, Any]]) -> str:
        """The rows as a Markdown table."""
        table = columns_of([{name: row[name] for name in SUMMARY_COLUMNS} for row in rows])
        return "\n".join([f"## Error against the number of views, within {self.range_m:g} m", "", markdown(table)])


def evenly(counts: Sequence[int]) -> list[tuple[int, int]]:
    """Every drive of every case, (case, drive), so that any stretch of them has the same share of each case's drives."""
    drives = [(case, drive) for case, count in enumerate(counts) for drive in range(count)]
    return sorted(drives, key=lambda each: ((each[1] + 0.5) / counts[each[0]], each))


def _metrics(rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> list[Metric]:
    """Errors with the most views and with the fewest."""
    found = []
    for which, label in ((-1, "most"), (0, "fewest")):
        for name in names:
            row = selected(rows, filter=name)[which]
            found += [
                Metric(f"{name}_{label}_rms", row["rms_m"], "m"),
                Metric(f"{name}_{label}_rms_common", row["rms_common_m"], "m"),
                Metric(f"{name}_{label}_nees", row["nees"], "1"),
            ]
    return [*found, Metric("odometry_rms", selected(rows, filter=names[0])[-1]["odometry_rms_m"], "m")]


def with_exponents(times: Sequence[Mapping[str, Any]], names: Sequence[str]) -> list[dict[str, Any]]:
    """The slope of log time over log N, of each filter over the larger half of its numbers, beside the times."""
    found = []
    for name in names:
        own = selected(times, filter=name)
        half = own[len(own) // 2 - (len(own) == 2) :]
        x, y = (np.log([row[key] for row in half]) for key in ("views", "step_ms"))
        exponent = float(np.polyfit(x, y, 1)[0]) if len(half) > 1 else float("nan")
        found += [{**row, "exponent": exponent} for row in own]
    return found
