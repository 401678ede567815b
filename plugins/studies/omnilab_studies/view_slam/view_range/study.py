"""View filters against the range of observation (Gil et al., 2012, figure 6)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from omnilab.api import Metric, Parts, Recorder, Report, ViewFilter, check_settings, setting
from omnilab.errors import ConfigError
from omnilab_studies.common.tables import columns_of, markdown
from omnilab_studies.view_slam import figures
from omnilab_studies.view_slam.display import show_drive
from omnilab_studies.view_slam.drives import Drive, Drives
from omnilab_studies.view_slam.filter_comparison import (
    FilterComparison,
    counts,
    seeds_of,
    selected,
    simulated_filters_of,
)
from omnilab_studies.view_slam.layout import VIEW_MAP
from omnilab_studies.view_slam.scenarios import Scenario, scenario

SUMMARY_COLUMNS = (
    "scenario",
    "range_m",
    "filter",
    "seeds",
    "rms_m",
    "worse_m",
    "final_rms_m",
    "odometry_rms_m",
    "nees",
    "gated",
)


@dataclass
class ViewRange:
    """Root mean square position error of view filters and of odometry against the range at which views are observed.

    Without images: a robot drives laps through scenarios, takes views at random places of the first and observes those
    in range and in line of sight by two noisy angles. Each seed draws another odometry and other views, the same at all
    ranges and for all filters. Nothing is aligned: the first pose is known. A filter has converged at the range from
    which on its mean error stays below a share of odometry's: no metric where there is none. NEES of x, y and heading is averaged over the seeds at each
    step, and `nees_within` is the share of steps where that mean lies within its 95 % bounds (3 is expected, 0.95).
    """

    ranges_m: list[float] = setting([1.5, 3.0, 4.5, 6.0, 7.5, 9.0, 10.5, 12.0, 15.0], above=0, fewest=1)  # of views
    scenarios: list[str] = field(default_factory=lambda: ["open", "walls"])  # shipped ones, or YAML files
    views: int = setting(12, at_least=1, at_most=10_000)  # on the first lap
    seeds: int = setting(50, at_least=2, at_most=100_000)  # drives
    fewer_seeds: dict[str, int] = setting({}, at_least=2, at_most=100_000)  # of a slow filter, by its name
    drives: Drives = field(default_factory=Drives)  # laps, noise, mishaps
    converged_share: float = setting(0.25, above=0, below=1)  # of odometry's error
    shown_range_m: float = setting(
        7.5, above=0
    )  # of the drive in the logs: the first seed's in the last scenario, by the first filter

    needs: ClassVar[tuple[str, ...]] = ()
    metric_names: ClassVar[tuple[str, ...]] = (
        "FILTER_SCENARIO_converged_from", "FILTER_SCENARIO_rms", "FILTER_SCENARIO_rms_common", "FILTER_SCENARIO_nees",
        "odometry_SCENARIO_rms", "observed", "wrong", "said",
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_settings(self, "study.")
        if not (self.ranges_m and self.scenarios and self.ranges_m == sorted(self.ranges_m) and self.ranges_m[0] > 0):
            raise ConfigError(
                f"study.ranges_m={self.ranges_m} in scenarios {self.scenarios}; give both, ranges ascending"
            )

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Run every filter on the same drives, in every scenario and at every range; measure."""
        filters, base = simulated_filters_of(parts), int(rng.integers(2**32))
        grounds, firsts = [scenario(name) for name in self.scenarios], dict[str, tuple[Scenario, Drive]]()
        record.log("", VIEW_MAP)
        comparison = FilterComparison(filters, self.seeds, self.fewer_seeds, record, rng)
        for ground in grounds:
            drives = self._drives(ground, base)
            firsts[ground.name] = ground, drives[0]
            self._compare(comparison, ground, drives, list(filters), record)
        return self._report(comparison, filters, firsts, record)

    def _drives(self, ground: Scenario, base: int) -> list[Drive]:
        """The drives of all seeds through a scenario."""
        return self.drives.drives(ground, self.views, base, self.seeds)

    def _compare(
        self, comparison: FilterComparison, ground: Scenario, drives: list[Drive], names: list[str], record: Recorder
    ) -> None:
        """Every filter at every range on the drives of a scenario."""
        cases = [(range_m, name) for range_m in self.ranges_m for name in names]
        for range_m, name in record.track(cases, f"drive: {ground.name}", len(cases), lambda _: 1):
            own = drives[: seeds_of(name, self.seeds, self.fewer_seeds)]
            case = {"scenario": ground.name, "range_m": range_m}
            comparison.compare(name, own, range_m, case, f"{ground.name}, {range_m:g} m")

    def _report(
        self, comparison: FilterComparison, filters: Mapping[str, ViewFilter],
        firsts: Mapping[str, tuple[Scenario, Drive]], record: Recorder,
    ) -> Report:  # fmt: skip
        """Metrics, tables, figures; and the last of the scenarios' first drives in the logs, by the first filter."""
        rows, names, (ground, drive) = comparison.rows, list(filters), list(firsts.values())[-1]
        estimate = show_drive(record, filters[names[0]], drive, ground, self.shown_range_m)
        drawn = {
            "scenarios": figures.scenarios(firsts, self.shown_range_m),
            "ranges": figures.against_range(rows, names),
            "nees": figures.consistency(rows, "range_m", "range of observation [m]", names),
            "drive": figures.drive(drive, ground, estimate, names[0], self.shown_range_m),
        }
        tables = {"ranges": columns_of(rows), "drives": columns_of(comparison.drive_rows)}
        return Report([*self._metrics(rows, names), *counts(rows)], tables, drawn, summary=_summary(rows))

    def _metrics(self, rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> list[Metric]:
        """Where each filter converges, and how it does at the longest range."""
        found = []
        for ground in dict.fromkeys(row["scenario"] for row in rows):
            for name in names:
                own = selected(rows, scenario=ground, filter=name)
                found.append(Metric(f"{name}_{ground}_converged_from", self.converged_from(own), "m"))
        found = [metric for metric in found if np.isfinite(metric.value)]
        for ground in dict.fromkeys(row["scenario"] for row in rows):
            for name in names:
                last = selected(rows, scenario=ground, filter=name)[-1]
                found += [
                    Metric(f"{name}_{ground}_rms", last["rms_m"], "m"),
                    Metric(f"{name}_{ground}_rms_common", last["rms_common_m"], "m"),
                    Metric(f"{name}_{ground}_nees", last["nees"], "1"),
                ]
            most = selected(rows, scenario=ground, filter=names[0])[-1]  # the filter that was on all drives
            found.append(Metric(f"odometry_{ground}_rms", most["odometry_rms_m"], "m"))
        return found

    def converged_from(self, rows: Sequence[Mapping[str, Any]]) -> float:
        """The range (rows ascend by it) from which on the mean error stays below the share of odometry's; NaN: none."""
        good = [row["rms_m"] < self.converged_share * row["odometry_rms_m"] for row in rows]
        if not good[-1]:
            return float("nan")
        last_bad = max((i for i, one in enumerate(good) if not one), default=-1)
        return float(rows[last_bad + 1]["range_m"])


def _summary(rows: Sequence[Mapping[str, Any]]) -> str:
    """The rows as a Markdown table."""
    table = columns_of([{name: row[name] for name in SUMMARY_COLUMNS} for row in rows])
    return "\n".join(["## Error against the range of observation", "", markdown(table)])
