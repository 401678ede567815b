"""Time, bytes, linearity and rates of methods against their parameters (Payá et al., 2016, figures 4-11)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    GridPoses,
    Metric,
    Parts,
    PoseRequest,
    RecordedPoses,
    Recorder,
    Report,
    Series,
    check_settings,
    setting,
)
from omnilab.errors import ConfigError, DataError
from omnilab_studies.common.grids import check_step_or_every, grid_poses
from omnilab_studies.common.logs import start_logs
from omnilab_studies.common.methods import key_of
from omnilab_studies.common.pose_sources import random_poses
from omnilab_studies.common.tables import columns_of, markdown
from omnilab_studies.descriptors.parameter_curves import figures
from omnilab_studies.descriptors.parameter_curves.layout import layout_of
from omnilab_studies.descriptors.parameter_curves.measures import Layouts, Measures
from omnilab_studies.descriptors.parameter_curves.parameters import (
    EXAMPLE,
    Parameter,
    Variant,
    parameters_of,
    steps_of,
    variants_of,
)
from omnilab_studies.descriptors.parameter_curves.points import CLOCK, UNITS, Point


@dataclass
class ParameterCurves:
    """Curves against numeric settings of components: sensor, disturbances, descriptors, distances, localizer.

    Every value of every parameter is tried with all else as the run has it, on the same images: time and bytes of a
    description, the distance curve along lines of a grid and how linear it is (Payá et al., 2016, 4.2 and 4.3, figures 4-11),
    the rate of nearest estimates and the heading's error in a map. Intervals are of 95 %, by resampling batches of images,
    reference places and queries. Times are in the table `times`: they differ from run to run.
    """

    parameters: dict[str, Any] = setting({})  # NAME: {of: descriptor.angles, values: [45, 90, 180]}; of several: a list
    step_m: float | None = setting(0.4, above=0)  # of the map; null: `every` n-th row and column of a recording
    every: int | None = setting(None, at_least=2)  # 2: even rows and even columns; the rest are the queries
    query_count: int = setting(100, at_least=0, at_most=1_000_000)  # random queries, where step_m is given; 0: no rates
    references: int = setting(24, at_least=0, at_most=1_000_000)  # places that lines start from; 0: no distance curves
    line_step_m: float = setting(0.1, above=0)  # from place to place of a line; of a recording, its grid's
    reach_m: float = setting(2.2, above=0)  # length of the lines
    repeats: int = setting(3, at_least=1, at_most=10_000)  # descriptions of every image, of which the fastest counts
    extent_m: list[float] | None = setting(
        None, above=0, count=2
    )  # x and y size of the grids; null: all that the sensor covers
    height_m: float | None = setting(None, at_least=-1e6, at_most=1e6)  # of the viewpoint; null: the sensor's own

    needs: ClassVar[tuple[str, ...]] = ("sensor",)
    metric_names: ClassVar[tuple[str, ...]] = (
        "r2_best", "nearest_best", "bytes_least", "points", "misfits", "lines", "places", "queries", "left_out",
        *(f"{name}_METHOD_PARAMETER_VALUE" for name in UNITS if name not in CLOCK),
    )  # fmt: skip
    cached: ClassVar[bool] = False  # a cached signature takes no time

    def __post_init__(self) -> None:
        check_settings(self, "study.")
        check_step_or_every(self.step_m, self.every)
        parameters_of(self.parameters)
        if self.references and self.line_step_m > self.reach_m / 3:
            raise ConfigError(
                f"study.line_step_m={self.line_step_m:g} makes no curve over study.reach_m={self.reach_m:g}; give at least 3"
                " steps, or study.references=0"
            )

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Try every value of every parameter, measure each method that it is of."""
        variants = self._variants(parts)
        start_logs(record, layout_of(self._parameters, self._quantities), parts.sensor)
        measures = Measures(self._layouts(rng), parts, record, rng)
        points: list[Point] = []
        misfits: list[str] = []
        for variant in record.track(variants, "values", len(variants), lambda _: 1):
            for found in self._points(measures, variant):
                (points if isinstance(found, Point) else misfits).append(found)  # type: ignore[arg-type]
        if not points:
            raise DataError(f"none of the values can be measured ({misfits[0]}); choose others")
        _show(record, points)
        return Report(
            _metrics(points, measures, misfits),
            _tables(points),
            _figures(points),
            summary=_summary(points, measures.counts),
            omitted=[*misfits, *measures.omitted],
        )

    def _variants(self, parts: Parts) -> list[Variant]:
        """The variants; ConfigError if there are none, or nothing that is measured depends on a parameter."""
        if not self._parameters:
            raise ConfigError(
                f"study.parameters is empty, so nothing varies; give such as +study.parameters.angles={EXAMPLE}"
            )
        if self._has_rates and parts.localizer is None:
            raise ConfigError("study.query_count asks for rates, which take a localizer; give localizer=nearest, or"
                              " study.query_count=0")  # fmt: skip
        for name, parameter in self._parameters.items():
            if not self._has_rates and all(path.startswith(("disturbances.", "localizer.")) for path in parameter.of):
                raise ConfigError(f"study.parameters.{name} changes what rates alone depend on, and study.query_count=0 asks"
                                  " for none; give study.query_count=100")  # fmt: skip
        return variants_of(parts, self._parameters)

    @property
    def _parameters(self) -> dict[str, Parameter]:
        return parameters_of(self.parameters)

    @property
    def _has_rates(self) -> bool:
        return self.query_count > 0

    @property
    def _quantities(self) -> list[str]:
        """What is drawn against the parameters."""
        lines, rates = ["r2"] if self.references else [], ["nearest", "heading_error"] if self._has_rates else []
        return ["describe_ms", "bytes", *lines, *rates]

    def _layouts(self, rng: np.random.Generator) -> Layouts:
        seed = int(rng.integers(2**32))
        grid = self._grid(self.line_step_m if self.every is None else None, None if self.every is None else 1)
        return Layouts(
            self._grid(self.step_m, self.every),
            self._query_poses(seed) if self._has_rates else None,
            grid if self.references else None,
            self.line_step_m,
            self.reach_m,
            self.references,
            self.repeats,
        )

    def _grid(self, step_m: float | None, every: int | None) -> GridPoses:
        return grid_poses(step_m, every, self.extent_m, self.height_m)

    def _query_poses(self, seed: int) -> PoseRequest:
        if self.every is not None:
            return RecordedPoses(without=self._grid(None, self.every))
        return random_poses(self.query_count, seed, None, self.extent_m, self.height_m)

    def _points(self, measures: Measures, variant: Variant) -> Iterator[Point | str]:
        """What each method measures at one value; or why it cannot."""
        measures.begin(variant.parts)
        for method in variant.methods:
            try:
                found = measures.cost(variant.parts, method)
                line = measures.curve(variant.parts, method) if self.references else None
                found |= measures.rates(variant.parts, method) if self._has_rates else {}
            except DataError as reason:
                yield f"{method.name} with {variant.parameter}={variant.value:g}: {reason}"
            else:
                yield Point(variant.parameter, variant.value, method, found | Point.of_line(line), line)


def _metrics(points: Sequence[Point], measures: Measures, misfits: Sequence[str]) -> list[Metric]:
    """All but times, which differ from run to run."""
    counts = measures.counts
    best = {name: [p.found[name].value for p in points if name in p.found] for name in ("r2", "nearest", "bytes")}
    found = [Metric(f"{name}_best", np.nanmax(best[name]), "1") for name in ("r2", "nearest") if best[name]]
    found += [
        Metric("bytes_least", min(best["bytes"]), "B"),
        Metric("points", len(points), "1"),
        Metric("misfits", len(misfits), "1"),
        *(Metric(name, counts[name], "1") for name in ("lines", "places", "queries") if name in counts),
        Metric("left_out", len(measures.omitted) + len(misfits), "1"),
    ]
    for point in points:
        for name, estimate in point.found.items():
            if name not in CLOCK:
                named = f"{name}_{key_of(point.method.name)}_{point.parameter}_{point.value:g}"
                interval = None if np.isnan(estimate.low) else (estimate.low, estimate.high)
                note = "" if np.isfinite(estimate.value) else "nothing tells any answer from other places"
                found.append(Metric(named, estimate.value, UNITS[name], interval, note))
    return found


def _tables(points: Sequence[Point]) -> dict[str, Mapping[str, Sequence[Any]]]:
    """A row a point: `parameters` without times, `times`; and every point of every distance curve."""
    tables: dict[str, Mapping[str, Sequence[Any]]] = {
        "parameters": columns_of([point.row(without=CLOCK) for point in points]),
        "times": columns_of([point.row(without=UNITS.keys() - CLOCK) for point in points]),
    }
    if rows := [row for point in points for row in point.line_rows()]:
        tables["curves"] = columns_of(rows)
    return tables


def _show(record: Recorder, points: Sequence[Point]) -> None:
    """The curves against each parameter, and the distance curves, with centimetres as steps."""
    for (parameter, name, method), own in figures.curves_of(points).items():
        steps = np.array(steps_of([point.value for point in own]))
        values = np.array([point.found[name].value for point in own])
        record.log(
            f"against/{name}/{parameter}_{method}", Series(values, steps, np.arange(len(own)) * 10**8, UNITS[name])
        )
    for point in points:
        if point.line is not None:
            centimetres = np.round(100 * point.line.curve.distance_m).astype(int)
            path = f"curves/{point.parameter}/{point.value:g}_{key_of(point.method.name)}"
            record.log(path, Series(point.line.curve.relative, centimetres, 10_000_000 * centimetres, "1"))


def _summary(points: Sequence[Point], counts: Mapping[str, int]) -> str:
    """A row a point, in the order of the parameters."""
    imaged = ", ".join(f"{count} {what}" for what, count in counts.items())
    rows = [{"parameter": p.parameter, "value": f"{p.value:g}", "method": p.method.name, **p.values} for p in points]
    return "\n".join([f"## Against parameters, {imaged}", "", markdown(columns_of(rows))])


def _figures(points: Sequence[Point]) -> dict[str, Any]:
    """One of all curves against parameters, and one of the distance curves of each parameter."""
    drawn = {"parameters": figures.against(points)}
    for parameter in dict.fromkeys(point.parameter for point in points if point.line is not None):
        drawn[f"curves_{parameter}"] = figures.distance_curves([p for p in points if p.parameter == parameter])
    return drawn
