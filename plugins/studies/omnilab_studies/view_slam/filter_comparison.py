"""Comparison of view filters on the same simulated drives."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Array, Batch, Floats, Metric, Parts, Recorder, Text, ViewFilter
from omnilab.errors import ConfigError
from omnilab.metrics import bootstrap
from omnilab_studies.view_slam.consistency import nees_bounds
from omnilab_studies.view_slam.drives import Drive
from omnilab_studies.view_slam.filter_runs import FilterTrace, position_rms, run_filter, trace_nees
from omnilab_studies.view_slam.landmark_front_end import observes_landmarks

MAX_LINES = 10  # of the filters' warnings, in the log


class FilterRun(NamedTuple):
    """A filter on one drive, in numbers."""

    rms_m: float
    final_rms_m: float  # of the trajectory at the end
    odometry_rms_m: float
    nees: Floats  # (T - 1,)
    observed: int
    gated: int
    wrong: int
    wrong_gated: int
    warnings: int
    step_ms: float  # median


def filters_of(parts: Parts) -> dict[str, ViewFilter]:
    """The run's view filters by name; ConfigError if there are none."""
    filters = dict(parts.view_filters)
    if not filters and parts.view_filter is not None:
        filters = {"view_filter": parts.view_filter}
    if not filters:
        raise ConfigError(
            "this study needs view filters; give +view_filter@view_filters.NAME=view_ekf, or view_filter="
        )
    if "odometry" in filters:
        raise ConfigError("view_filters.odometry has the name of what filters are compared with; give it another")
    return filters


def simulated_filters_of(parts: Parts) -> dict[str, ViewFilter]:
    """Those of `filters_of`; ConfigError for one that observes landmarks, of which simulated drives have none."""
    filters = filters_of(parts)
    for name, view_filter in filters.items():
        if observes_landmarks(view_filter):
            raise ConfigError(
                f"view_filters.{name} observes landmarks, and these drives have views alone; leave it out, or give"
                " experiment=view_slam, which has images"
            )
    return filters


def seeds_of(name: str, seeds: int, fewer: Mapping[str, int]) -> int:
    """On how many drives a filter goes."""
    return min(seeds, fewer.get(name, seeds))


class LogLimiter:
    """Puts warnings into the log, up to `MAX_LINES` of them."""

    def __init__(self, record: Recorder) -> None:
        self._record, self._lines = record, 0

    def log(self, where: str, warnings: Sequence[str]) -> None:
        """Warnings of one place, such as an image or a drive."""
        for warning in warnings[: max(0, MAX_LINES - self._lines)]:
            self._record.log("log", Text(f"{where}: {warning}", "WARN"))
        self._lines += len(warnings)


class FilterComparison:
    """View filters on the same drives, case by case: rows of the tables.

    The first filter comes first in each case: the others are compared with it. `fewer` says which go on fewer drives.
    """

    def __init__(
        self, filters: Mapping[str, ViewFilter], seeds: int, fewer: Mapping[str, int], record: Recorder,
        rng: np.random.Generator,
    ) -> None:  # fmt: skip
        self.rows: list[dict[str, Any]] = []  # one a case and filter
        self.drive_rows: list[dict[str, Any]] = []  # one a drive, case and filter
        self._filters, self._record, self._rng = filters, record, rng
        self._common = min(seeds_of(name, seeds, fewer) for name in filters)
        self._first: list[FilterRun] = []  # of the case
        self._limiter = LogLimiter(record)

    def compare(
        self, name: str, drives: Sequence[Drive], range_m: float, case: Mapping[str, Any], label: str
    ) -> list[FilterRun]:
        """One filter on the drives of a case: values of the table's first columns, and a label for warnings."""
        with self._record.timed(f"filter: {name}", len(drives)):
            found = [evaluated_run(self._filters[name], drive, range_m) for drive in drives]
        return self.add(name, [(run, trace.warnings) for run, trace in found], case, label)

    def add(
        self, name: str, found: Sequence[tuple[FilterRun, Sequence[str]]], case: Mapping[str, Any], label: str
    ) -> list[FilterRun]:
        """One filter's runs on the drives of a case, with its warnings: rows of the tables."""
        runs = [run for run, _ in found]
        for _, warnings in found:
            self._limiter.log(f"{name}, {label}", warnings)
        if name == next(iter(self._filters)):
            self._first = runs
        columns = {**case, "filter": name}
        self.rows.append({**columns, **row_of(runs, self._first, self._common, self._rng)})
        self.drive_rows += [{**columns, **row} for row in drives_of(runs)]
        return runs


def batch_of(run: FilterRun, warnings: Sequence[str]) -> dict[str, Array]:
    """A run and its warnings as arrays, which can be kept and joined."""
    numbers = {name: np.array([value]) for name, value in run._asdict().items() if name != "nees"}
    return numbers | {"nees": run.nees, "steps": np.array([len(run.nees)]), "sentences": np.array(warnings, np.str_)}


def runs_of(batch: Batch) -> Iterator[tuple[FilterRun, list[str]]]:
    """The runs of which a batch was made, or several that were joined; each with its warnings."""
    names = [name for name in FilterRun._fields if name != "nees"]
    series = np.split(batch["nees"], np.cumsum(batch["steps"])[:-1])
    texts = np.split(batch["sentences"], np.cumsum(batch["warnings"])[:-1])
    rows = zip(*(batch[name].tolist() for name in names), strict=True)
    for row, nees, sentences in zip(rows, series, texts, strict=True):
        yield FilterRun(nees=nees, **dict(zip(names, row, strict=True))), sentences.tolist()


def evaluated_run(view_filter: ViewFilter, drive: Drive, range_m: float) -> tuple[FilterRun, FilterTrace]:
    """A filter on a drive, and its errors."""
    trace = run_filter(view_filter, drive, range_m)
    return FilterRun(
        position_rms(trace.poses, drive.truth), position_rms(trace.final_poses, drive.truth),
        position_rms(drive.odometry, drive.truth), trace_nees(trace, drive),
        trace.observed, trace.gated, trace.wrong, trace.wrong_gated, len(trace.warnings),
        1e3 * float(np.median(trace.seconds[1:])),
    ), trace  # fmt: skip


def row_of(
    runs: Sequence[FilterRun], first: Sequence[FilterRun], common: int, rng: np.random.Generator
) -> dict[str, Any]:
    """A filter's runs on several drives, in one row.

    `first`: the runs of the first filter; `worse_m` is by how much this filter's error exceeds that one's on the same
    drives, on average, with the 95 % interval by bootstrap. `common`: the first drives, on which all filters went.
    """
    rms, observed = np.array([run.rms_m for run in runs]), sum(run.observed for run in runs)
    wrong = sum(run.wrong for run in runs)
    mean_nees = np.mean(_cut_to_shortest([run.nees for run in runs]), axis=0)
    low, high = nees_bounds(len(runs))
    worse = np.array([run.rms_m - other.rms_m for run, other in zip(runs, first, strict=False)])
    worse_low, worse_high = bootstrap(lambda chosen: float(worse[chosen].mean()), len(worse), rng)
    return {
        "seeds": len(runs),
        "rms_m": float(rms.mean()),
        "rms_sigma_m": float(rms.std(ddof=1)),
        "rms_common_m": float(rms[:common].mean()),
        "worse_m": float(worse.mean()),
        "worse_low_m": worse_low,
        "worse_high_m": worse_high,
        "final_rms_m": float(np.mean([run.final_rms_m for run in runs])),
        "odometry_rms_m": float(np.mean([run.odometry_rms_m for run in runs])),
        "odometry_sigma_m": float(np.std([run.odometry_rms_m for run in runs], ddof=1)),
        "nees": float(mean_nees.mean()),
        "nees_low": low,
        "nees_high": high,
        "nees_within": float(((low <= mean_nees) & (mean_nees <= high)).mean()),
        "nees_median": float(np.median([np.median(run.nees) for run in runs])),
        "observed": observed,
        "gated": sum(run.gated for run in runs) / max(1, observed - wrong),
        "wrong": wrong,
        "wrong_gated": sum(run.wrong_gated for run in runs) / wrong if wrong else float("nan"),
        "warnings": sum(run.warnings for run in runs),
    }


def drives_of(runs: Sequence[FilterRun]) -> list[dict[str, Any]]:
    """A filter's runs, one row a drive."""
    return [
        {
            "drive": number, "rms_m": run.rms_m, "final_rms_m": run.final_rms_m, "odometry_rms_m": run.odometry_rms_m,
            "nees": float(run.nees.mean()), "observed": run.observed, "gated": run.gated,
        }
        for number, run in enumerate(runs)
    ]  # fmt: skip


def _cut_to_shortest(series: Sequence[Floats]) -> Floats:
    """As many rows, cut to the shortest: halts make drives differ in length."""
    length = min(len(one) for one in series)
    return np.array([one[:length] for one in series])


def selected(rows: Sequence[Mapping[str, Any]], **wanted: Any) -> list[Mapping[str, Any]]:
    """The rows with these values."""
    return [row for row in rows if all(row[name] == value for name, value in wanted.items())]


def counts(rows: Sequence[Mapping[str, Any]]) -> Iterator[Metric]:
    """Observations, wrong ones and warnings of all runs together, as metrics."""
    columns = {"observed": "observed", "wrong": "wrong", "said": "warnings"}  # of metrics the names stay
    for name, column in columns.items():
        yield Metric(name, sum(row[column] for row in rows), "1")
