"""Time and memory of descriptors and distances, against the rate of nearest estimates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    Descriptor,
    GridPoses,
    Metric,
    Parts,
    PlaceMap,
    PoseRequest,
    RecordedPoses,
    Recorder,
    Report,
    check_settings,
    setting,
)
from omnilab.errors import DataError
from omnilab.metrics import distances_to, first_alike, is_flat, spacing, tie_distance, verdicts
from omnilab_studies.common.frames import deliver, deliver_queries
from omnilab_studies.common.grids import check_step_or_every, grid_poses
from omnilab_studies.common.logs import start_logs
from omnilab_studies.common.methods import Method, check_comparisons, descriptors_of, key_of, methods_of, prepared
from omnilab_studies.common.pose_sources import random_poses
from omnilab_studies.common.scores import check_apart
from omnilab_studies.common.tables import columns_of, markdown
from omnilab_studies.common.timing import timed
from omnilab_studies.descriptors.cost import figures
from omnilab_studies.descriptors.cost.timed_signatures import TimedImages, TimedSignatures
from omnilab_studies.descriptors.figures import pareto
from omnilab_studies.descriptors.layout import layout_of

Row = dict[str, Any]


@dataclass
class Cost:
    """Time and memory of every descriptor and distance (Payá et al., 2016, figures 4-6, table 4).

    Places of a grid and queries are described and compared as `grid` does. Times are those of the process on this
    machine, averaged over all images or queries, after a warm-up: of the view that the descriptor wants (unwrapping a
    panorama), of its description, of preparing the map, and of one query against the map. Beside them stand the bytes of
    a place and the rate of nearest estimates.
    """

    step_m: float | None = setting(
        0.4, above=0
    )  # of the grid of places; null: take `every` n-th row and column of a recording
    every: int | None = setting(None, at_least=2)  # 2: even rows and even columns; the rest are the queries
    query_count: int = setting(200, at_least=1, at_most=1_000_000)  # how many random queries, where step_m is given
    repeats: int = setting(
        3, at_least=1, at_most=10_000
    )  # comparisons of all queries with the map, of which the fastest counts
    extent_m: list[float] | None = setting(
        None, above=0, count=2
    )  # x and y size of the grid; null: all that the sensor covers
    height_m: float | None = setting(None, at_least=-1e6, at_most=1e6)  # of the viewpoint; null: the sensor's own

    needs: ClassVar[tuple[str, ...]] = ("sensor",)
    metric_names: ClassVar[tuple[str, ...]] = (
        "nearest_best", "bytes_least", "contestants", "misfits", "places", "queries", "left_out", "nearest_METHOD",
        "bytes_DESCRIPTOR",
    )  # fmt: skip
    cached: ClassVar[bool] = False  # a cached signature takes no time

    def __post_init__(self) -> None:
        check_settings(self, "study.")
        check_step_or_every(self.step_m, self.every)

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Take images, describe them by every descriptor, compare by every distance, measure the time of each."""
        methods = methods_of(parts)
        start_logs(record, layout_of(), parts.sensor)
        places, queries, omitted = self._images(parts, descriptors_of(methods), record, rng)
        record.log("places", PlaceMap(places.position_m))
        described = _describe(descriptors_of(methods), places, queries, record)
        rows, misfits = self._compare(methods, described, places, queries, record)
        table = columns_of(rows)
        return Report(
            _metrics(rows, places, queries, omitted, misfits),
            {"times": table},
            _figures(rows),
            summary=_summary(table, places, queries),
            omitted=[*misfits, *omitted],
        )

    def _images(
        self, parts: Parts, descriptors: Mapping[str, Descriptor], record: Recorder, rng: np.random.Generator
    ) -> tuple[TimedImages, TimedImages, list[str]]:
        """Places and queries, in every view that a descriptor wants; and what was left out."""
        plan, grid = parts.sensor.plan(self._query_poses(rng)), parts.sensor.plan(self._grid())
        places = TimedImages.of(deliver(parts, grid, record, "places"), len(grid), descriptors, record)
        batches = deliver_queries(parts, plan, record, int(rng.integers(2**32)))
        queries = TimedImages.of(batches, len(plan), descriptors, record)
        return places, queries, [*grid.omitted, *places.omitted, *plan.omitted, *queries.omitted]

    def _compare(
        self, methods: Sequence[Method], described: Mapping[str, TimedSignatures], places: TimedImages,
        queries: TimedImages, record: Recorder,
    ) -> tuple[list[Row], list[str]]:  # fmt: skip
        """One row a method; and why other distances cannot compare the signatures. DataError if none can."""
        rows: list[Row] = []
        misfits: list[str] = []
        for method in record.track(methods, "compare", len(methods), lambda _: 1):
            try:
                rows.append(self._row(method, described[method.descriptor_name], places, queries))
            except DataError as reason:
                misfits.append(f"{method.name}: {reason}")
        if not rows:
            raise DataError(f"none of the distances can compare any of the signatures ({misfits[0]}); choose others")
        return rows, misfits

    def _grid(self) -> GridPoses:
        return grid_poses(self.step_m, self.every, self.extent_m, self.height_m)

    def _query_poses(self, rng: np.random.Generator) -> PoseRequest:
        if self.every is not None:
            return RecordedPoses(without=self._grid())
        return random_poses(self.query_count, int(rng.integers(2**32)), None, self.extent_m, self.height_m)

    def _row(self, method: Method, described: TimedSignatures, places: TimedImages, queries: TimedImages) -> Row:
        """One method's line of the table; DataError if the distance cannot compare such signatures."""
        check_comparisons(len(described.queries), len(described.places))
        method.distance.match(described.queries[slice(1)], prepared(method, described.places))  # the warm-up
        index, prepare_s = timed(lambda: method.distance.prepare(described.places))
        runs = [timed(lambda: method.distance.match(described.queries, index)) for _ in range(self.repeats)]
        query_ms = 1e3 * min(seconds for _, seconds in runs) / len(described.queries)
        field = runs[0][0].distance
        answer, step_m, alike = field.argmin(axis=1), spacing(places.position_m), first_alike(described.places)
        check_apart(places.position_m, step_m)
        or_these = (alike[None, :] == alike[answer][:, None]) | is_flat(field)[:, None]
        to_places = distances_to(queries.position_m, places.position_m)
        nearest = verdicts(to_places, answer, tie_distance(step_m), or_these) == "nearest"
        return {
            "method": method.name,
            "descriptor": method.descriptor_name,
            "parameters": described.settings,
            "distance": method.distance_name,
            "fit_s": described.fit_s,
            "view_ms": described.view_ms,
            "describe_ms": described.describe_ms,
            "prepare_ms": 1e3 * prepare_s,
            "query_ms": query_ms,
            "localise_ms": described.view_ms + described.describe_ms + query_ms,
            "bytes": described.places.nbytes / len(described.places),
            "nearest_rate": float(nearest.mean()),
        }


def _describe(
    descriptors: Mapping[str, Descriptor], places: TimedImages, queries: TimedImages, record: Recorder
) -> dict[str, TimedSignatures]:
    """The signatures by every descriptor."""
    return {
        name: TimedSignatures.by(descriptor, places, queries)
        for name, descriptor in record.track(descriptors.items(), "describe", len(descriptors), lambda _: 1)
    }


def _metrics(
    rows: Sequence[Row], places: TimedImages, queries: TimedImages, omitted: Sequence[str], misfits: Sequence[str]
) -> list[Metric]:
    """Bytes and rates alone: times differ from run to run."""
    found = [
        Metric("nearest_best", max(row["nearest_rate"] for row in rows), "1"),
        Metric("bytes_least", min(row["bytes"] for row in rows), "B"),
        Metric("contestants", len(rows), "1"),  # of metrics the names stay: saved runs are repeated by them
        Metric("misfits", len(misfits), "1"),
        Metric("places", len(places), "1"),
        Metric("queries", len(queries), "1"),
        Metric("left_out", len(omitted), "1"),
    ]
    found += [Metric(f"nearest_{key_of(row['method'])}", row["nearest_rate"], "1") for row in rows]
    bytes_of = {row["descriptor"]: row["bytes"] for row in rows}
    return found + [Metric(f"bytes_{name}", value, "B") for name, value in bytes_of.items()]


def _summary(table: Mapping[str, Sequence[Any]], places: TimedImages, queries: TimedImages) -> str:
    title = f"## Cost, {len(places)} places, {len(queries)} queries"
    hidden = {"method", "parameters", "localise_ms"}
    return "\n".join([title, "", markdown({k: column for k, column in table.items() if k not in hidden})])


def _figures(rows: Sequence[Row]) -> dict[str, Any]:
    shown = ("describe_ms", "query_ms")
    points = {row["method"]: (row["localise_ms"], row["nearest_rate"]) for row in rows}
    return {
        "times": figures.bars(
            {row["method"]: {name.removesuffix("_ms"): row[name] for name in shown} for row in rows},
            "ms an image, ms a query against the map", "Describing, and comparing with the map",
        ),
        "pareto": pareto(points, "ms a query: view, description, comparison", "answered the nearest place", "Time against accuracy"),
    }  # fmt: skip
