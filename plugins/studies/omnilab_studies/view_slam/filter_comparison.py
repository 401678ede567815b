"""The view filters that a study compares, and what each did on every drive."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Floats, Metric, Parts, Recorder, Text, ViewFilter
from omnilab.errors import ConfigError
from omnilab.metrics import bootstrap
from omnilab_studies.view_slam.consistency import nees_bounds
from omnilab_studies.view_slam.drives import Drive
from omnilab_studies.view_slam.filter_runs import Trace, follow, position_rms, trace_nees

MAX_LINES = 10  # of what filters say, in the log


class Ran(NamedTuple):
    """A filter on a drive, in numbers."""

    rms_m: float
    final_rms_m: float  # of the way at the end
    odometry_rms_m: float
    nees: Floats  # (T - 1,)
    observed: int
    gated: int
    wrong: int
    wrong_gated: int
    warnings: int
    step_ms: float  # median


def rivals_of(parts: Parts) -> dict[str, ViewFilter]:
    """The run's view filters by name; ConfigError if there are none."""
    found = dict(parts.view_filters) or _alone(parts.view_filter)
    if not found:
        raise ConfigError(
            "this study needs view filters; give +view_filter@view_filters.NAME=view_ekf, or view_filter="
        )
    if "odometry" in found:
        raise ConfigError("view_filters.odometry has the name of what filters are compared with; give it another")
    return found


def _alone(view_filter: ViewFilter | None) -> dict[str, ViewFilter]:
    return {} if view_filter is None else {"view_filter": view_filter}


def seeds_of(name: str, seeds: int, fewer: Mapping[str, int]) -> int:
    """On how many drives a filter goes."""
    return min(seeds, fewer.get(name, seeds))


def check_seeds(seeds: int, fewer: Mapping[str, int]) -> None:
    """ConfigError for numbers of drives that are none."""
    for name, count in {"seeds": seeds, **{f"fewer_seeds.{name}": count for name, count in fewer.items()}}.items():
        if count < 2:
            raise ConfigError(f"study.{name}={count} has no spread; give 2 or more")


class Teller:
    """Puts what filters say into the log, so long as it is not too much."""

    def __init__(self, record: Recorder) -> None:
        self._record, self._lines = record, 0

    def tell(self, where: str, said: Sequence[str]) -> None:
        """Sentences about a drive."""
        for sentence in said[: max(0, MAX_LINES - self._lines)]:
            self._record.log("log", Text(f"{where}: {sentence}", "WARN"))
        self._lines += len(said)


def ran(view_filter: ViewFilter, drive: Drive, range_m: float) -> tuple[Ran, Trace]:
    """A filter on a drive."""
    trace = follow(view_filter, drive, range_m)
    return Ran(
        position_rms(trace.poses, drive.truth), position_rms(trace.way, drive.truth),
        position_rms(drive.odometry, drive.truth), trace_nees(trace, drive),
        trace.observed, trace.gated, trace.wrong, trace.wrong_gated, len(trace.warnings),
        1e3 * float(np.median(trace.seconds[1:])),
    ), trace  # fmt: skip


def row_of(runs: Sequence[Ran], first: Sequence[Ran], common: int, rng: np.random.Generator) -> dict[str, Any]:
    """What a filter did on several drives, in one row.

    `first`: what the first filter did, of which it is told by how much this one is worse on the same drives, on average
    and with the 95 % interval of that by bootstrap. `common`: the first drives, on which all filters went.
    """
    rms, observed = np.array([one.rms_m for one in runs]), sum(one.observed for one in runs)
    wrong = sum(one.wrong for one in runs)
    over_runs = np.mean(_aligned([one.nees for one in runs]), axis=0)
    low, high = nees_bounds(len(runs))
    worse = np.array([one.rms_m - other.rms_m for one, other in zip(runs, first, strict=False)])
    worse_low, worse_high = bootstrap(lambda chosen: float(worse[chosen].mean()), len(worse), rng)
    return {
        "seeds": len(runs),
        "rms_m": float(rms.mean()),
        "rms_sigma_m": float(rms.std(ddof=1)),
        "rms_common_m": float(rms[:common].mean()),
        "worse_m": float(worse.mean()),
        "worse_low_m": worse_low,
        "worse_high_m": worse_high,
        "final_rms_m": float(np.mean([one.final_rms_m for one in runs])),
        "odometry_rms_m": float(np.mean([one.odometry_rms_m for one in runs])),
        "odometry_sigma_m": float(np.std([one.odometry_rms_m for one in runs], ddof=1)),
        "nees": float(over_runs.mean()),
        "nees_low": low,
        "nees_high": high,
        "nees_within": float(((low <= over_runs) & (over_runs <= high)).mean()),
        "nees_median": float(np.median([np.median(one.nees) for one in runs])),
        "observed": observed,
        "gated": sum(one.gated for one in runs) / max(1, observed - wrong),
        "wrong": wrong,
        "wrong_gated": sum(one.wrong_gated for one in runs) / wrong if wrong else float("nan"),
        "warnings": sum(one.warnings for one in runs),
    }


def drives_of(runs: Sequence[Ran]) -> list[dict[str, Any]]:
    """What a filter did, drive by drive."""
    return [
        {
            "drive": number, "rms_m": one.rms_m, "final_rms_m": one.final_rms_m, "odometry_rms_m": one.odometry_rms_m,
            "nees": float(one.nees.mean()), "observed": one.observed, "gated": one.gated,
        }
        for number, one in enumerate(runs)
    ]  # fmt: skip


def _aligned(series: Sequence[Floats]) -> Floats:
    """As many rows, cut to the shortest: halts make drives differ in length."""
    length = min(len(one) for one in series)
    return np.array([one[:length] for one in series])


def columns(rows: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Rows with the same keys as a table."""
    return {name: [row[name] for row in rows] for name in rows[0]}


def selected(rows: Sequence[Mapping[str, Any]], **wanted: Any) -> list[Mapping[str, Any]]:
    """The rows with these values."""
    return [row for row in rows if all(row[name] == value for name, value in wanted.items())]


def counts(rows: Sequence[Mapping[str, Any]]) -> Iterator[Metric]:
    """What went wrong in all runs together, gated and said."""
    for name in ("observed", "wrong", "warnings"):
        yield Metric(name, sum(row[name] for row in rows), "1")
