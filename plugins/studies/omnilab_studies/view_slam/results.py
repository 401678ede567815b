"""Results of view-based SLAM from images: errors and consistency of every filter, figures 8 to 10, files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Floats, Metric, Recorder, Report
from omnilab.posegraph.graph import matrices
from omnilab.trajectory.evaluation import path_length, rms
from omnilab.trajectory.files import tum_text
from omnilab_studies.common.tables import columns_of, markdown_table
from omnilab_studies.view_slam import figures
from omnilab_studies.view_slam.consistency import errors, nees, nees_bounds
from omnilab_studies.view_slam.display import show_errors
from omnilab_studies.view_slam.filter_runs import FilterEstimate, position_rms
from omnilab_studies.view_slam.front_end import FilterClock, ViewAssociation
from omnilab_studies.view_slam.landmark_front_end import LANDMARKS, LandmarkMapper
from omnilab_studies.view_slam.mapping_run import ViewMappingRun

UNITS = {
    "rms": "m", "end": "m", "final_rms": "m", "heading_rms": "deg", "nees": "1", "nees_median": "1", "nees_within": "1",
    "views": "1", "observed": "1", "gated": "1",
}  # fmt: skip


class FilterResult(NamedTuple):
    """One filter's trajectory and map at the end."""

    estimate: FilterEstimate
    final_poses: Floats  # (T, 3) of the trajectory at the end
    row: dict[str, Any]  # of the table `filters`


def report(run: ViewMappingRun, walls_m: Floats, record: Recorder) -> Report:
    """Metrics, tables, figures among walls (W, 2, 2), and files of a run; the first filter's errors into the logs."""
    truth, odometry = np.array(run.truth), np.array(run.odometry)
    filters = {name: _filter_result(run, name, truth) for name in run.mappers}
    first = next(iter(filters.values())).estimate
    show_errors(record, first.poses, first.covariances, truth)
    rows = [result.row for result in filters.values()]
    poses = {"odometry": odometry, "truth": truth}
    for name, result in filters.items():
        poses |= {name: result.estimate.poses, f"{name}_final": result.final_poses}
    metrics = _metrics(run, rows, truth, odometry)
    stamps_ns, clocks = np.array(run.stamps_ns), {name: mapper.clock for name, mapper in run.mappers.items()}
    return Report(
        metrics,
        tables={"filters": columns_of(rows), "steps": _step_table(run, poses), "times": columns_of(time_rows(clocks))},
        figures={
            **figures.maps(truth, odometry, walls_m, {name: result.estimate for name, result in filters.items()}),
            "cost": figures.cost(clocks),
        },
        files={f"{name}.tum": tum_text(matrices(p), stamps_ns) for name, p in poses.items()},
        summary=markdown_table(metrics, "Maps of views"),
    )


def _filter_result(run: ViewMappingRun, name: str, truth: Floats) -> FilterResult:
    """One filter, with its errors against the true poses (T, 3)."""
    mapper = run.mappers[name]
    poses, covariances = (np.array(each) for each in zip(*mapper.poses, strict=True))
    final = mapper.map.finish()
    what = LANDMARKS if isinstance(mapper, LandmarkMapper) else "views"
    estimate = FilterEstimate(poses, covariances, mapper.map.views(), mapper.map.view_covariances(), what)
    row = _row(name, estimate, final, truth, run.associations[name], len(mapper.images) - run.known)
    return FilterResult(estimate, final, row)


def _row(
    name: str, estimate: FilterEstimate, final: Floats, truth: Floats, associations: Sequence[ViewAssociation],
    views: int,
) -> dict[str, Any]:  # fmt: skip
    """Errors and consistency of a filter, in one row of the table."""
    error = errors(estimate.poses, truth)
    step_nees = nees(error[1:], estimate.covariances[1:])
    low, high = nees_bounds(1)
    observed = sum(len(association.views) for association in associations)
    return {
        "filter": name,
        "rms": position_rms(estimate.poses, truth),
        "end": float(np.hypot(*error[-1, :2])),
        "final_rms": position_rms(final, truth),
        "heading_rms": float(np.rad2deg(rms(error[:, 2]))),
        "nees": float(step_nees.mean()),
        "nees_median": float(np.median(step_nees)),
        "nees_within": float(((low <= step_nees) & (step_nees <= high)).mean()),
        "views": views,
        "observed": observed,
        "gated": 1 - sum(int(association.believed.sum()) for association in associations) / max(1, observed),
    }


def _metrics(run: ViewMappingRun, rows: Sequence[Mapping[str, Any]], truth: Floats, odometry: Floats) -> list[Metric]:
    """The rows of all filters, and what they have in common, as metrics."""
    return [
        *(Metric(f"{row['filter']}_{key}", row[key], unit) for key, unit in UNITS.items() for row in rows),
        *(
            Metric(f"{name}_variables", mapper.clock.variables[-1], "1")
            for name, mapper in run.mappers.items()
            if mapper.clock.variables
        ),
        Metric("odometry_rms", position_rms(odometry, truth), "m"),
        Metric("images", len(truth), "1"),
        Metric("path_length", float(path_length(matrices(truth))[-1]), "m"),
        Metric("lost_steps", run.failed_steps, "1"),
        *([Metric("known_views", run.known, "1")] if run.known else []),
    ]


def time_rows(clocks: Mapping[str, FilterClock]) -> list[dict[str, Any]]:
    """Medians of the milliseconds that filters take for an image: over all, and over the last tenth, with the largest map.

    A table and no metric: they depend on what else the machine does. What finds and matches features takes is not among them.
    """
    rows = []
    for name, clock in clocks.items():
        ms = 1e3 * np.array(clock.seconds)
        variables = clock.variables[-1] if clock.variables else float("nan")
        last = ms[-max(1, len(ms) // 10) :]
        rows.append(
            {
                "filter": name,
                "variables": variables,
                "step_ms": np.median(ms),
                "last_ms": np.median(last),
                "total_s": ms.sum() / 1e3,
            }
        )
    return rows


def _step_table(run: ViewMappingRun, poses: Mapping[str, Floats]) -> dict[str, Any]:
    """A row an image: every trajectory (T, 3), and each filter's observations."""
    table: dict[str, Any] = {"image": np.arange(len(run.truth)), "key": run.keys}
    for name, at in poses.items():
        table |= {f"{name}_x_m": at[:, 0], f"{name}_y_m": at[:, 1], f"{name}_heading_deg": np.rad2deg(at[:, 2])}
    for name, associations in run.associations.items():
        table[f"{name}_observed"] = [len(association.views) for association in associations]
        table[f"{name}_believed"] = [int(association.believed.sum()) for association in associations]
    return table
