"""Study G: distance between images against metric distance (Payá et al., 2016)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    GridPoses,
    Ints,
    Metric,
    Parts,
    PathPoses,
    PlaceMap,
    Plan,
    Recorder,
    Report,
    Series,
    Signatures,
    Tick,
    check_settings,
    setting,
)
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import planar_poses
from omnilab_studies.common.describing import check_signatures
from omnilab_studies.common.frames import deliver
from omnilab_studies.common.grids import grid_poses
from omnilab_studies.common.logs import show_picture, start_logs
from omnilab_studies.common.methods import (
    Method,
    check_comparisons,
    describe_all,
    descriptors_of,
    fitted_all,
    joined_signatures,
    key_of,
    methods_of,
    prepared,
    settings_of,
)
from omnilab_studies.common.scores import known_poses, warn_of_equal_signatures
from omnilab_studies.common.tables import markdown
from omnilab_studies.descriptors.curves import Curve, lines_on_grid, whole_lines
from omnilab_studies.descriptors.figures import pareto
from omnilab_studies.descriptors.layout import layout_of
from omnilab_studies.descriptors.linearity import figures

Table = Mapping[str, Sequence[Any]]


@dataclass
class Linearity:
    """Study G: image distance against metric distance, for every descriptor with every distance.

    From reference places on a grid, straight lines along its rows and columns: mean and variance over the lines of the
    distance between the images at each metric distance, the line through the origin that fits the mean best, and how
    far the mean rises (Payá et al., 2016, 4.3, figures 7-11, table 4; Berenguer, thesis, figures 4.4, 4.5). Lines that
    meet furniture or the grid's edge are left out whole. All images have the same heading, as in the papers.
    """

    step_m: float = setting(0.1, above=0)  # of the grid
    reach_m: float = setting(2.2, above=0)  # length of the lines
    references: int = setting(
        24, at_least=1, at_most=1_000_000
    )  # places that lines start from, drawn at random; each has one to four lines
    every: int | None = setting(None, at_least=1)  # of a recording, whose every n-th row and column are step_m apart
    random_headings: bool = False  # at every place; only for sensors that image any pose
    extent_m: list[float] | None = setting(
        None, above=0, count=2
    )  # x and y size of the grid; null: all that the sensor covers
    height_m: float | None = setting(None, at_least=-1e6, at_most=1e6)  # of the viewpoint; null: the sensor's own
    show: int = setting(50, at_least=0)  # images that go into the logs

    needs: ClassVar[tuple[str, ...]] = ("sensor",)
    metric_names: ClassVar[tuple[str, ...]] = (
        "r2_best", "monotone_best_m", "contestants", "misfits", "lines", "references", "images", "left_out",
        "r2_METHOD",
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_settings(self, "study.")
        if not 0 < self.step_m <= self.reach_m / 3:
            raise ConfigError(
                f"study.step_m={self.step_m} makes no curve over study.reach_m={self.reach_m}; give a step above 0 m, and"
                " at least 3 steps"
            )

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Draw lines, describe their images, compare the first image of each with the others, fit."""
        if parts.disturbances:
            raise ConfigError("linearity has no queries to disturb; leave disturbance out")
        start_logs(record, layout_of(list(descriptors_of(methods_of(parts)))), parts.sensor)
        grid = parts.sensor.plan(self._grid())
        lines, nodes = self._lines(grid, record, rng)
        plan = self._with_headings(grid.at(nodes), parts, rng)

        parts = fitted_all(parts, plan, record)
        methods = methods_of(parts)
        signatures, delivered, omitted = self._describe(parts, methods, plan, record)
        omitted = [*grid.omitted, *omitted]
        lines = whole_lines(np.searchsorted(nodes, lines), delivered)
        curves, misfits = self._curves(methods, signatures, lines, record)

        table = _table([method for method in methods if method.name in curves], curves, signatures)
        return Report(
            _metrics(curves, lines, omitted, misfits),
            {"linearity": table, "curves": _points(curves)},
            _figures(methods, curves, table),
            summary=_summary(table, lines),
            omitted=[*misfits, *omitted],
        )

    def _lines(self, grid: Plan, record: Recorder, rng: np.random.Generator) -> tuple[Ints, Ints]:
        """Lines (A, n + 1) of indices into the grid, and the nodes that they have, each once."""
        position_m = known_poses(grid.T_world_camera, "images")[:, :3, 3]
        lines = lines_on_grid(position_m, self.step_m, self.reach_m, self.references, rng)
        nodes = np.unique(lines)
        record.log("places", PlaceMap(position_m[nodes]))
        return lines, nodes

    def _grid(self) -> GridPoses:
        return grid_poses(self.step_m if self.every is None else None, self.every, self.extent_m, self.height_m)

    def _with_headings(self, plan: Plan, parts: Parts, rng: np.random.Generator) -> Plan:
        """The plan with random headings where the settings say so."""
        if not self.random_headings:
            return plan
        position_m = known_poses(plan.T_world_camera, "images")[:, :3, 3]
        return parts.sensor.plan(PathPoses(planar_poses(position_m, rng.uniform(-np.pi, np.pi, len(plan)))))

    def _describe(
        self, parts: Parts, methods: Sequence[Method], plan: Plan, record: Recorder
    ) -> tuple[dict[str, Signatures], Ints, list[str]]:
        """Signatures by descriptor, which frames of the plan they are of, and what could not be delivered."""
        batches: dict[str, list[Signatures]] = {name: [] for name in descriptors_of(methods)}
        delivered: list[Ints] = []
        keys: list[str] = []
        omitted: list[str] = []
        every = max(1, -(-len(plan) // self.show)) if self.show > 0 else len(plan) + 1
        for frames in deliver(parts, plan, record, "images"):
            for name, described in describe_all(methods, frames, record).items():
                if not batches[name]:
                    check_signatures(described, len(plan), "images")
                batches[name].append(described)
            delivered.append(frames.plan_index)
            keys += frames.keys
            omitted += frames.omitted
            for i in np.flatnonzero((frames.plan_index + 1) % every == 0):
                show_picture(record, frames, int(i), Tick(int(frames.plan_index[i]), int(frames.stamps_ns[i])))
        if not delivered:
            raise DataError("the sensor delivered no images for the study's lines; look at what it left out")
        joined = {name: joined_signatures(b) for name, b in batches.items()}
        warn_of_equal_signatures(joined, keys, "images", record)
        return joined, np.concatenate(delivered), omitted

    def _curves(
        self, methods: Sequence[Method], signatures: Mapping[str, Signatures], lines: Ints, record: Recorder
    ) -> tuple[dict[str, Curve], list[str]]:
        """The curve of each method; and why other distances cannot compare the signatures. DataError if none can."""
        curves: dict[str, Curve] = {}
        misfits: list[str] = []
        for method in record.track(methods, "compare", len(methods), lambda _: 1):
            try:
                curves[method.name] = self._curve(method, signatures[method.descriptor_name], lines, record)
                _log(record, method.name, curves[method.name])
            except DataError as reason:
                misfits.append(f"{method.name}: {reason}")
        if not curves:
            raise DataError(f"none of the distances can compare any of the signatures ({misfits[0]}); choose others")
        return curves, misfits

    def _curve(self, method: Method, signatures: Signatures, lines: Ints, record: Recorder) -> Curve:
        """Mean and variance over the lines (A, n + 1); DataError if the distance cannot compare such signatures."""
        references, row = np.unique(lines[:, 0], return_inverse=True)
        check_comparisons(len(references), len(signatures))
        index = prepared(method, signatures)
        with record.timed("compare", len(references) * len(signatures)):
            field = method.distance.match(signatures[references], index).distance
        values = field[row[:, None], lines[:, 1:]].astype(np.float64)
        return Curve(np.round(self.step_m * np.arange(1, lines.shape[1]), 9), values.mean(axis=0), values.var(axis=0))


def _log(record: Recorder, name: str, curve: Curve) -> None:
    """The mean curve, relative to its highest value, with centimetres as steps."""
    centimetres = np.round(100 * curve.distance_m).astype(int)
    path = f"curves/{name.replace(' + ', '/')}"
    record.log(path, Series(curve.relative, centimetres, 10_000_000 * centimetres, "1"))


def _table(methods: Sequence[Method], curves: Mapping[str, Curve], signatures: Mapping[str, Signatures]) -> Table:
    """One row per method, as table 4 of Payá et al. (2016)."""
    found = [curves[method.name] for method in methods]
    described = [signatures[method.descriptor_name] for method in methods]
    return {
        "descriptor": [method.descriptor_name for method in methods],
        "parameters": [settings_of(method.descriptor) for method in methods],
        "distance": [method.distance_name for method in methods],
        "slope_per_m": [curve.slope for curve in found],
        "r2_centred": [curve.r2_centred for curve in found],
        "r2_origin": [curve.r2_origin for curve in found],
        "monotone_m": [curve.monotone_m for curve in found],
        "spread": [curve.spread for curve in found],
        "bytes": [d.nbytes / len(d) for d in described],
        "place_bytes": [d.place.nbytes / len(d) for d in described],
    }


def _points(curves: Mapping[str, Curve]) -> Table:
    """Every point of every curve."""
    rows = [
        (name, *point)
        for name, curve in curves.items()
        for point in zip(curve.distance_m.tolist(), curve.mean.tolist(), curve.variance.tolist(), strict=True)
    ]
    columns = list(zip(*rows, strict=True))
    return dict(zip(("method", "distance_m", "mean", "variance"), columns, strict=True))


def _metrics(curves: Mapping[str, Curve], lines: Ints, omitted: list[str], misfits: list[str]) -> list[Metric]:
    best = max(curves.values(), key=lambda curve: curve.r2_centred)
    return [
        Metric("r2_best", best.r2_centred, "1"),
        Metric("monotone_best_m", max(curve.monotone_m for curve in curves.values()), "m"),
        Metric("contestants", len(curves), "1"),  # of metrics the names stay: saved runs are repeated by them
        Metric("misfits", len(misfits), "1"),
        Metric("lines", len(lines), "1"),
        Metric("references", len(np.unique(lines[:, 0])), "1"),
        Metric("images", len(np.unique(lines)), "1"),
        Metric("left_out", len(omitted), "1"),
        *(Metric(f"r2_{key_of(name)}", curve.r2_centred, "1") for name, curve in curves.items()),
    ]


def _summary(table: Table, lines: Ints) -> str:
    """The methods by r², the best first."""
    shown = ("descriptor", "distance", "slope_per_m", "r2_centred", "r2_origin", "monotone_m", "bytes")
    order = np.argsort(table["r2_centred"])[::-1]
    title = f"## Image distance against metric distance, {len(lines)} lines"
    return "\n".join([title, "", markdown({name: [table[name][i] for i in order] for name in shown})])


def _figures(methods: Sequence[Method], curves: Mapping[str, Curve], table: Table) -> dict[str, Any]:
    groups: dict[str, dict[str, Curve]] = {name: {} for name in descriptors_of(methods)}
    for method in methods:
        if method.name in curves:
            groups[method.descriptor_name][method.distance_name] = curves[method.name]
    groups = {name: of for name, of in groups.items() if of}
    bytes_of = dict(zip(table["descriptor"], table["place_bytes"], strict=True))
    best = {name: max(of, key=lambda distance: of[distance].r2_centred) for name, of in groups.items()}
    points = {f"{name} + {d}": (bytes_of[name], groups[name][d].r2_centred) for name, d in best.items()}
    return {
        "curves": figures.curves(groups),
        "pareto": pareto(points, "bytes that tell the place", "r² (centred)", "Each descriptor with its best distance"),
    }
