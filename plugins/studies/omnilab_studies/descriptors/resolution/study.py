"""Study E: size of a descriptor against success and time (thesis, figure 4.22)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    Answers,
    Floats,
    Metric,
    Parts,
    PathPoses,
    PlaceMap,
    Recorder,
    Report,
    Series,
    Tick,
    check_settings,
    setting,
)
from omnilab.errors import ConfigError, did_you_mean
from omnilab.metrics import VERDICTS
from omnilab_studies.common.frames import deliver
from omnilab_studies.common.free_area import free_square, poses_with_headings, positions_within
from omnilab_studies.common.logs import show_signature, start_logs
from omnilab_studies.common.method_runs import MethodCost, MethodRuns
from omnilab_studies.common.methods import Method
from omnilab_studies.common.samples import of_known
from omnilab_studies.common.scores import ScoredEstimates, joined_estimates, known_poses
from omnilab_studies.common.tables import columns_of
from omnilab_studies.descriptors.resolution import figures
from omnilab_studies.descriptors.resolution.layout import LAYOUT

ANY, ON_GRID = "any", "on_grid"  # kinds of headings
POINT = 0.01  # of the rate: so much less than the largest size counts as the same
SIZE_NS = 100_000_000  # between two sizes, in the logs
THESIS = [[709, 360], [355, 180], [173, 180], [173, 90], [173, 45], [87, 90], [87, 45], [43, 45], [22, 6]]

Row = dict[str, Any]
Key = tuple[str, str]  # a method or a distance, and the kind of headings


@dataclass
class Resolution:
    """Study E: a descriptor in several sizes, against success and time (Berenguer, thesis, 4.6.5, figure 4.22).

    `side` x `side` places and queries at the same positions for all sizes, once with headings on the angle grid of each
    size, where a rotation shifts its samples by whole ones, and once with any heading. The first size is the
    reference; `smallest` is the size with fewest numbers whose rate of nearest answers is at most one point below.
    """

    side: int = setting(8, at_least=2, at_most=1000)  # places along x and along y
    step_m: float = setting(0.2, above=0)  # between places
    center_m: list[float] = setting([0.0, 0.0], count=2)  # the map is the free square nearest to it
    query_count: int = setting(
        500, at_least=1, at_most=1_000_000
    )  # queries of each kind of headings, evenly over the map's area
    height_m: float | None = setting(None, at_least=-1e6, at_most=1e6)  # of the viewpoint; null: the sensor's own
    settings: list[str] = field(default_factory=lambda: ["offsets", "angles"])  # two of the descriptor; angles last
    sizes: list[list[int]] = setting([list(size) for size in THESIS], at_least=1, fewest=1)  # values, largest first

    needs: ClassVar[tuple[str, ...]] = ("sensor", "descriptor", "distance", "localizer")
    metric_names: ClassVar[tuple[str, ...]] = (
        "smallest_SETTING_DISTANCE_HEADINGS", "nearest_rate_SIZE_DISTANCE_HEADINGS",
        "heading_error_median_SIZE_DISTANCE_HEADINGS",
    )  # fmt: skip
    cached: ClassVar[bool] = False  # it measures time

    def __post_init__(self) -> None:
        check_settings(self, "study.")
        if len(self.settings) != 2:
            raise ConfigError(f"study.settings={self.settings} are not two; give such as [offsets, angles]")
        if not self.sizes or any(len(size) != 2 or min(size) < 1 for size in self.sizes):
            raise ConfigError(f"study.sizes={self.sizes} are no sizes; give a list of [{', '.join(self.settings)}]")
        if len({tuple(size) for size in self.sizes}) < len(self.sizes):
            raise ConfigError(f"study.sizes={self.sizes} has a size twice; give each once")

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Describe the map in every size, localise queries with both kinds of headings, score."""
        start_logs(record, LAYOUT, parts.sensor)
        sizes = self._sized(parts.descriptor)
        distances = parts.distances or {"distance": parts.distance}
        grid = free_square(parts.sensor, self.side, self.step_m, self.center_m, self.height_m)
        record.log("places", PlaceMap(known_poses(grid.T_world_camera, "places")[:, :3, 3]))
        runs = MethodRuns(replace(parts, descriptors=sizes, distances=distances), grid, record)

        at, share = positions_within(grid, self.query_count, rng), rng.random(self.query_count)
        scored = self._localize_all(parts, runs, list(sizes), at, share, record)
        runs.log_degeneracy()
        rows = self._rows(runs, distances, scored)
        curves = _curves(rows)
        _show_rates(record, curves)
        drawn = {"resolution": figures.resolution(curves), "pareto": figures.pareto(curves)}
        tables = {"resolution": columns_of(rows)}
        return Report(_metrics(rows, self.settings), tables, drawn, summary=_markdown(rows))

    def _sized(self, descriptor: Any) -> dict[str, Any]:
        """The descriptor in every size."""
        known = [f.name for f in fields(descriptor)]
        for name in self.settings:
            if name not in known:
                raise ConfigError(
                    f"study.settings names '{name}', which is no setting of {type(descriptor).__name__};"
                    f" there is {', '.join(known)}{did_you_mean(name, known)}"
                )
        sizes = (dict(zip(self.settings, size, strict=True)) for size in self.sizes)
        return {" x ".join(str(v) for v in size.values()): replace(descriptor, **size) for size in sizes}

    def _localize_all(
        self, parts: Parts, runs: MethodRuns, sizes: Sequence[str], at: Floats, share: Floats, record: Recorder
    ) -> dict[Key, ScoredEstimates]:
        """Localise queries at positions (Q, 3), by every size with any heading, and with those of its own angle grid."""
        any_heading = poses_with_headings(at, share)
        scored = _localize(parts, runs, sizes, any_heading, ANY, "queries, any heading", record)
        first = next(iter(scored.values()))
        record.log("answers", Answers(first.truth_m, first.answer_m, list(first.verdict)))
        for angles in dict.fromkeys(size[1] for size in self.sizes):
            names = [name for name, size in zip(sizes, self.sizes, strict=True) if size[1] == angles]
            on_grid = poses_with_headings(at, share, angles)
            scored |= _localize(parts, runs, names, on_grid, ON_GRID, f"queries, {angles} headings", record)
        return scored

    def _rows(self, runs: MethodRuns, distances: Mapping[str, Any], scored: Mapping[Key, ScoredEstimates]) -> list[Row]:
        """One row a distance, kind of headings and size."""
        return [
            self._row(method, name, headings, runs.cost(method), scored[method.name, headings])
            for name, distance in distances.items()
            for headings in (ON_GRID, ANY)
            for method in runs.methods
            if method.distance is distance
        ]

    def _row(self, method: Method, distance: str, headings: str, cost: MethodCost, scored: ScoredEstimates) -> Row:
        size = {setting: getattr(method.descriptor, setting) for setting in self.settings}
        error_deg = scored.heading_error_deg
        return {
            "size": " x ".join(str(value) for value in size.values()),
            **size,
            "numbers": int(np.prod(list(size.values()))),
            "distance": distance,
            "headings": headings,
            "queries": len(scored.verdict),
            **{f"{verdict}_rate": float(np.mean(scored.verdict == verdict)) for verdict in VERDICTS},
            "heading_error_median_deg": of_known(np.median, error_deg),
            "heading_error_p95_deg": of_known(partial(np.quantile, q=0.95), error_deg),
            **cost._asdict(),
        }


def _localize(
    parts: Parts, runs: MethodRuns, names: Sequence[str], poses: PathPoses, headings: str, stage: str, record: Recorder
) -> dict[Key, ScoredEstimates]:
    """The estimates of some sizes for the queries with one kind of headings."""
    batches: dict[Key, list[ScoredEstimates]] = {}
    for frames in deliver(parts, parts.sensor.plan(poses), record, stage):
        for found in runs.localize_by(list(names), frames):
            batches.setdefault((found.method.name, headings), []).append(found.scored)
            if headings == ANY and 0 in frames.plan_index:
                step = names.index(found.method.descriptor_name)
                show_signature(record, found.signatures.place[0], Tick(step, SIZE_NS * step))
    return {key: joined_estimates(own) for key, own in batches.items()}


def _show_rates(record: Recorder, curves: Mapping[Key, Sequence[Row]]) -> None:
    """The rate of nearest estimates over the sizes, for every distance and kind of headings."""
    for curve, own in curves.items():
        steps = np.arange(len(own))
        values = np.array([row["nearest_rate"] for row in own])
        record.log("nearest/" + "_".join(curve), Series(values, steps, SIZE_NS * steps, "1"))


def _curves(rows: Sequence[Row]) -> dict[Key, list[Row]]:
    """The rows of each distance and kind of headings, a size each."""
    found: dict[Key, list[Row]] = {}
    for row in rows:
        found.setdefault((row["distance"], row["headings"]), []).append(row)
    return found


def smallest(rows: Sequence[Row]) -> Row:
    """The row with fewest numbers whose rate of nearest answers is at most one point below that of the first."""
    enough = [row for row in rows if row["nearest_rate"] >= rows[0]["nearest_rate"] - POINT - 1e-9]
    return min(enough, key=lambda row: int(row["numbers"]))


def _metrics(rows: Sequence[Row], settings: Sequence[str]) -> list[Metric]:
    """The smallest sufficient sizes first, then the rates of all."""
    found = []
    for curve, own in _curves(rows).items():
        found += [Metric(f"smallest_{setting}_{'_'.join(curve)}", smallest(own)[setting], "1") for setting in settings]
    for row in rows:
        key = f"{row['size'].replace(' ', '')}_{row['distance']}_{row['headings']}"
        found.append(Metric(f"nearest_rate_{key}", row["nearest_rate"], "1"))
        if np.isfinite(row["heading_error_median_deg"]):
            found.append(Metric(f"heading_error_median_{key}", row["heading_error_median_deg"], "deg"))
    return found


def _markdown(rows: Sequence[Row]) -> str:
    """Rates by size, the smallest sufficient one in bold, with bytes and time of a size."""
    curves = _curves(rows)
    titles = [f"{distance}, {headings.replace('_', ' ')}" for distance, headings in curves]
    lines = ["## Resolution", "", "nearest answers; bold: the smallest size within one point of the first", ""]
    lines += [f"| size | {' | '.join(titles)} | KiB | describe, ms |", "|---" * (len(titles) + 3) + "|"]
    for of_size in zip(*curves.values(), strict=True):
        cells = []
        for row, own in zip(of_size, curves.values(), strict=True):
            rate = f"{row['nearest_rate']:.3f}"
            cells.append(f"**{rate}**" if row is smallest(own) else rate)
        cost = f"{of_size[0]['bytes_per_place'] / 1024:.3g} | {of_size[0]['describe_ms']:.3g}"
        lines.append(f"| {of_size[0]['size']} | {' | '.join(cells)} | {cost} |")
    return "\n".join(lines)
