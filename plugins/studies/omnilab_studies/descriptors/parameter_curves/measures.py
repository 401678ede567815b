"""What is measured of a method at one value of a parameter: cost, distance curve, rates. Nothing is made twice."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Floats, GridPoses, Ints, Parts, PlaceMap, Places, PoseRequest, Recorder
from omnilab.metrics import first_alike, spacing
from omnilab_studies.common.frames import deliver, deliver_queries
from omnilab_studies.common.methods import Method, check_comparisons, prepared
from omnilab_studies.common.scores import joined_estimates, known_poses, score
from omnilab_studies.common.timing import timed
from omnilab_studies.descriptors.curves import Curve, lines_on_grid, whole_lines
from omnilab_studies.descriptors.parameter_curves.pictures import Pictures

RESAMPLES = 1000  # for an interval


class Measured(NamedTuple):
    """A number with its 95 % interval: NaN where there is none."""

    value: float
    low: float = float("nan")
    high: float = float("nan")


class LineCurve(NamedTuple):
    """Image distance over metric distance, with intervals by resampling the places that lines start from."""

    curve: Curve
    low: Floats  # (n,) of the mean
    high: Floats
    r2: Measured


class Layouts(NamedTuple):
    """What is imaged, as the study's settings have it."""

    map: GridPoses
    queries: PoseRequest | None  # None: no rates
    grid: GridPoses | None  # of the lines; None: no distance curves
    line_step_m: float
    reach_m: float
    references: int
    repeats: int  # descriptions of each image, of which the fastest counts


class Measures:
    """Measures methods. Pictures and signatures are kept as long as their components are in use."""

    def __init__(self, layouts: Layouts, parts: Parts, record: Recorder, rng: np.random.Generator) -> None:
        self._layouts, self._record, self._own = layouts, record, _identities(parts)
        self._line_seed, self._disturbance_seed, self._seed = (int(n) for n in rng.integers(2**32, size=3))
        self._pictures: dict[tuple[str, *tuple[int, ...]], Pictures] = {}  # by what they are of, and made by
        self.omitted: dict[str, None] = {}  # sentences, each once

    def begin(self, parts: Parts) -> None:
        """Forget what was made by components that are neither the run's own nor of these parts."""
        used = self._own | _identities(parts)
        self._pictures = {key: made for key, made in self._pictures.items() if used.issuperset(key[1:])}
        for pictures in self._pictures.values():
            pictures.forget(but=used)

    def cost(self, parts: Parts, method: Method) -> dict[str, Measured]:
        """Milliseconds and bytes an image: of the pictures of the map, or of the lines where there is no map."""
        only_lines = self._layouts.queries is None and self._layouts.grid is not None
        pictures = self._lines(parts) if only_lines else self._map(parts)
        found, rng = pictures.described_by(method.descriptor, self._layouts.repeats), self._rng()
        return {
            "fit_ms": Measured(found.fit_ms),
            "fit_cpu_ms": Measured(found.fit_cpu_ms),
            "view_ms": _estimate(np.median, found.view_ms, rng),
            "describe_ms": _estimate(np.median, found.describe_ms, rng),
            "describe_cpu_ms": _estimate(np.median, found.describe_cpu_ms, rng),
            "bytes": Measured(found.signatures.nbytes / len(pictures)),
        }

    def curve(self, parts: Parts, method: Method) -> LineCurve:
        """The distance curve; DataError if the distance cannot compare such signatures."""
        pictures = self._lines(parts)
        lines = pictures.lines
        signatures = pictures.described_by(method.descriptor, self._layouts.repeats).signatures
        references, row = np.unique(lines[:, 0], return_inverse=True)
        check_comparisons(len(references), len(signatures))
        field = method.distance.match(signatures[references], prepared(method, signatures)).distance
        values = field[row[:, None], lines[:, 1:]].astype(np.float64)
        distance_m = np.round(self._layouts.line_step_m * np.arange(1, lines.shape[1]), 9)
        curve = Curve(distance_m, values.mean(axis=0), values.var(axis=0))

        means = _resampled_means(values, row, self._rng())
        low, high = np.quantile(means, [0.025, 0.975], axis=0)
        r2 = np.quantile([Curve(distance_m, mean, curve.variance).r2_centred for mean in means], [0.025, 0.975])
        return LineCurve(curve, low, high, Measured(curve.r2_centred, *r2.tolist()))

    def rates(self, parts: Parts, method: Method) -> dict[str, Measured]:
        """Rate of nearest estimates, errors, time; DataError if the distance cannot compare such signatures."""
        places, queries = self._map(parts), self._queries(parts)
        found = places.described_by(method.descriptor, self._layouts.repeats)
        seen = queries.described_by(found.descriptor, 1).signatures
        prepared(method, found.signatures)
        poses = known_poses(places.frames.T_world_camera, "places")
        at, alike = poses[:, :3, 3], first_alike(found.signatures)
        index = parts.localizer.prepare(Places(found.signatures, poses, places.frames.keys), method.distance)
        parts.localizer.locate(seen[slice(1)], index)  # the warm-up
        runs = [timed(partial(parts.localizer.locate, seen[which], index)) for which in queries.batches]
        scored = joined_estimates(
            [score(queries.part(w), e, at, spacing(at), alike) for w, (e, _) in zip(queries.batches, runs, strict=True)]
        )
        rng = self._rng()
        return {
            "nearest": _estimate(np.mean, (scored.verdict == "nearest").astype(float), rng),
            "position_error": _estimate(np.median, scored.error_m, rng),
            "heading_error": _estimate(np.median, scored.heading_error_deg, rng),
            "locate_ms": _estimate(np.median, queries.each_ms([seconds for _, seconds in runs]), rng),
        }

    @property
    def counts(self) -> dict[str, int]:
        """How many lines, places and queries there were, the first time that they were imaged."""
        found: dict[str, int] = {}
        for (what, *_), pictures in self._pictures.items():
            found.setdefault(what, len(pictures.lines) if what == "lines" else len(pictures))
        return found

    # ------------------------------------------------------------------------------------------------------ pictures
    def _map(self, parts: Parts) -> Pictures:
        return self._once("places", partial(self._take_map, parts), id(parts.sensor))

    def _queries(self, parts: Parts) -> Pictures:
        spoilt_by = (id(disturbance) for disturbance in parts.disturbances.values())
        return self._once("queries", partial(self._take_queries, parts), id(parts.sensor), *spoilt_by)

    def _lines(self, parts: Parts) -> Pictures:
        return self._once("lines", partial(self._take_lines, parts), id(parts.sensor))

    def _once(self, what: str, take: Callable[[], Pictures], *by: int) -> Pictures:
        """Pictures, taken unless components of these identities have already."""
        if (what, *by) not in self._pictures:
            self._pictures[what, *by] = take()
            self.omitted |= dict.fromkeys(self._pictures[what, *by].omitted)
        return self._pictures[what, *by]

    def _take_map(self, parts: Parts) -> Pictures:
        plan = parts.sensor.plan(self._layouts.map)
        pictures = Pictures(deliver(parts, plan, self._record, "places"), plan, self._record)
        if pictures.frames.T_world_camera is not None:
            self._record.log("places", PlaceMap(pictures.frames.T_world_camera[:, :3, 3]))
        return pictures

    def _take_queries(self, parts: Parts) -> Pictures:
        assert self._layouts.queries is not None
        plan = parts.sensor.plan(self._layouts.queries)
        return Pictures(deliver_queries(parts, plan, self._record, self._disturbance_seed), plan, self._record)

    def _take_lines(self, parts: Parts) -> Pictures:
        """Pictures of the places of lines along a grid."""
        layouts = self._layouts
        assert layouts.grid is not None
        grid = parts.sensor.plan(layouts.grid)
        position_m = known_poses(grid.T_world_camera, "images")[:, :3, 3]
        rng = np.random.default_rng(self._line_seed)
        lines = lines_on_grid(position_m, layouts.line_step_m, layouts.reach_m, layouts.references, rng)
        nodes = np.unique(lines)
        plan = grid.at(nodes)
        pictures = Pictures(deliver(parts, plan, self._record, "lines"), plan, self._record)
        pictures.lines = whole_lines(np.searchsorted(nodes, lines), pictures.frames.plan_index)
        return pictures

    def _rng(self) -> np.random.Generator:
        return np.random.default_rng(self._seed)


def _identities(parts: Parts) -> set[int]:
    """Those of all components of a run."""
    held = [value.values() if isinstance(value, Mapping) else [value] for value in vars(parts).values()]
    return {id(component) for components in held for component in components}


def _estimate(statistic: Callable[..., Any], sample: Floats, rng: np.random.Generator) -> Measured:
    """A statistic of a sample, of its finite values alone, as `omnilab.metrics.bootstrap` has it, all resamples at once."""
    known = sample[np.isfinite(sample)]
    if not len(known):
        return Measured(float("nan"))
    found = statistic(known[rng.integers(len(known), size=(RESAMPLES, len(known)))], axis=1)
    return Measured(float(statistic(known)), *np.quantile(found, [0.025, 0.975]).tolist())


def _resampled_means(values: Floats, row: Ints, rng: np.random.Generator) -> Floats:
    """Means (B, n) of values (A, n) of lines, the references (A,) that they start from drawn anew: lines of one go together."""
    count = int(row.max()) + 1
    sums, sizes = np.zeros((count, values.shape[1])), np.bincount(row)
    np.add.at(sums, row, values)
    drawn = rng.integers(count, size=(RESAMPLES, count))
    return np.asarray(sums[drawn].sum(axis=1) / sizes[drawn].sum(axis=1)[:, None])
