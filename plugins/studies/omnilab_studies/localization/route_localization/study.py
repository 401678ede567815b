"""Localisation along a route: a map from one drive, queries from its other images or from another drive."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, ClassVar, NamedTuple

import numpy as np

from omnilab.api import (
    Answers,
    Floats,
    Image,
    Ints,
    Localizer,
    Metric,
    Parts,
    PlaceMap,
    Places,
    Plan,
    Recorder,
    Report,
    Series,
    Text,
    check_settings,
    setting,
)
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import planar_poses
from omnilab.metrics import distances_to, spacing, tie_distance, verdicts
from omnilab_studies.common.logs import start_logs
from omnilab_studies.common.methods import Method, check_comparisons, fitted_all, methods_of, prepared
from omnilab_studies.common.plots import pixels_of
from omnilab_studies.common.pose_sources import Source, check_is_trajectory, plan_of_trajectory
from omnilab_studies.common.scores import Degeneracy, check_apart
from omnilab_studies.common.tables import columns_of, markdown
from omnilab_studies.localization.route_localization import figures
from omnilab_studies.localization.route_localization.ambiguity import (
    PlaceSets,
    left_out,
    nonconformity,
    place_sets,
    threshold,
    true_places,
)
from omnilab_studies.localization.route_localization.drives import DriveReader, RouteDrive, truth_of
from omnilab_studies.localization.route_localization.layout import LAYOUT
from omnilab_studies.localization.route_localization.results import (
    Compass,
    RouteErrors,
    compass,
    error_rows,
    metrics_of,
    query_rows,
    route_errors,
)
from omnilab_studies.localization.route_localization.route import apart, courses, filled


class QueryChoice(Enum):
    """Which images are localised."""

    rest = "rest"  # all images of the drive that are not places
    midway = "midway"  # those half-way between two places, in the drive's order
    other = "other"  # another drive: the sensor `sensors.queries`


class HeadingReference(Enum):
    """What headings of the answers are compared with."""

    course = "course"  # the direction of travel: of a robot that drives forwards, and whatever its files say
    recorded = "recorded"  # the sensor's


class CalibrationSource(Enum):
    """By what the sets of places are calibrated."""

    map = "map"  # each place of the map, localised in the rest of it
    queries = "queries"  # every second query whose position is known; the others test


@dataclass
class RouteLocalization:
    """Localise along a route: every n-th image of a drive is a place, in order; methods and localizers side by side.

    The queries are the drive's other images or another drive (`+sensor@sensors.queries=folder sensors.queries.path=DIR
    study.queries=other`), whose positions may be known of some images only (`truth`, a CSV with image, x_m, y_m): all of
    them are localised, in order, those are scored. Errors are split along and across the route; headings are compared with
    the course. Every one of `descriptors` by every one of `localizers`; localizers of sequences see the queries in order.

    For each query there is also the set of all places that it may be, by conformal prediction (Vovk et al., 2005): a share
    `confidence` of the sets holds the truth (a place within one step of the one nearest to it), as far as the queries are
    like what calibrates. A set that reaches farther than `elsewhere_steps` from its best place is `ambiguous`: the
    images do not tell which of its places it is.

    The visual compass sums up the rotations between consecutive images of the drive.
    """

    images: Source = Source.path  # of the map's drive: path or recorded
    path: str = "round"  # of the world, or a file of poses, where images=path
    every: int | None = setting(10, at_least=1)  # every n-th image is a place; null: by step_m
    step_m: float | None = setting(None, above=0)  # places are at least so far apart
    queries: QueryChoice = QueryChoice.rest  # rest, midway or other
    query_path: str | None = None  # path of another drive in a virtual world; null: that of the map
    truth: str | None = None  # file with positions of the queries, where their sensor has none
    headings: HeadingReference = HeadingReference.course  # course or recorded
    course_m: float = setting(0.25, above=0, at_most=1000)  # the course is that from so far before to so far after
    confidence: float = setting(0.95, above=0, below=1)  # of the sets of places
    calibration: CalibrationSource = CalibrationSource.map  # of the sets: map or queries
    elsewhere_steps: float = setting(
        5.0, at_least=1, at_most=1000
    )  # places of a set that are farther from its best, in steps of the map, are elsewhere
    height_m: float | None = setting(None, at_least=-1e6, at_most=1e6)  # of the viewpoint; null: the sensor's own
    show: int = setting(20, at_least=0)  # queries whose images go into the logs; the numbers of all of them do

    needs: ClassVar[tuple[str, ...]] = ("sensor",)
    metric_names: ClassVar[tuple[str, ...]] = (
        *(f"METHOD_LOCALIZER_{kind}_error_{which}" for kind in ("position", "along", "across", "heading")
          for which in ("median", "p90", "worst")),
        *(f"METHOD_compass_error_{which}" for which in ("median", "p90", "worst")),
        "METHOD_set_coverage", "METHOD_set_size_median", "METHOD_set_extent_median", "METHOD_ambiguous_rate",
        "places", "map_step", "queries", "queries_with_truth", "left_out",
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_settings(self, "study.")
        check_is_trajectory(self.images)
        if (self.every is None) == (self.step_m is None):
            raise ConfigError(
                f"study.every={self.every} and study.step_m={self.step_m} are given; give one of the two and null for the other"
            )
        if self.queries is not QueryChoice.other and (self.truth or self.query_path):
            raise ConfigError(
                "study.truth and study.query_path are of another drive; give study.queries=other, or leave them out"
            )

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Describe the drives, localise by every method and localizer, score: `route.csv` has a row for each of these."""
        localizers = _localizers_of(parts)
        start_logs(record, LAYOUT, parts.sensor)
        plan = plan_of_trajectory(parts.sensor, self.images, self.path, self.height_m)
        at = self._places(plan)
        other = self._other_drive(parts)
        parts = fitted_all(parts, plan.at(at), record)
        methods = methods_of(parts)
        reader = DriveReader(
            methods, record, self.course_m if self.headings is HeadingReference.course else None, self.show
        )

        own = self._queries_of(at, len(plan)) if other is None else None
        drive = reader.described(parts, plan, "route", queries=own)
        at = self._chosen(drive.position_m)
        queries = drive.at(self._queries_of(at, len(drive)))
        if other is not None:
            every = np.arange(len(other[1]))
            queries = reader.described(*other, seed=int(rng.integers(2**32)), queries=every)
        check_comparisons(len(queries) + len(at), len(at))
        route = RouteMap.of(drive.at(at), self.course_m)
        record.log("places", PlaceMap(route.position_m, route.heading))

        methods, unfit = _fit(methods, route, record)
        errors, failed = _localize(methods, localizers, route, queries, record)
        sets = {m.name: self._sets(m, route, queries) for m in methods}
        compasses = list(_compasses(methods, drive))
        _log(record, errors, sets, route, queries)
        return _report(errors, sets, compasses, route, queries, [*drive.omitted, *unfit, *failed], rng, record)

    def _places(self, plan: Plan) -> Ints:
        """Which images of the map's drive are planned to be places."""
        if plan.T_world_camera is None:
            raise DataError("the images of the route have no positions; give a positions file (sensor.positions)")
        return self._chosen(plan.T_world_camera[:, :3, 3])

    def _chosen(self, position_m: Floats) -> Ints:
        chosen = np.arange(0, len(position_m), self.every) if self.step_m is None else apart(position_m, self.step_m)
        if len(chosen) < 2:
            raise DataError(
                f"of the {len(position_m)} images of the route {len(chosen)} is a place, and a map has two or more; give a"
                " smaller study.every or study.step_m"
            )
        return chosen

    def _queries_of(self, places: Ints, count: int) -> Ints:
        """Which images of the map's drive are queries."""
        between = (places[:-1] + places[1:]) // 2
        chosen = (
            np.setdiff1d(between, places)
            if self.queries is QueryChoice.midway
            else np.setdiff1d(np.arange(count), places)
        )
        if not len(chosen) and self.queries is not QueryChoice.other:
            raise DataError(
                f"all {count} images of the route are places, and none is left to localise; give a larger study.every or"
                " study.step_m, or another drive with study.queries=other"
            )
        return chosen

    def _other_drive(self, parts: Parts) -> tuple[Parts, Plan, str, Floats | None] | None:
        """The other drive: its sensor, plan and true positions; None where the queries are of the map's own."""
        sensor = parts.sensors.get("queries")
        if (sensor is None) == (self.queries is QueryChoice.other):
            raise ConfigError(
                f"study.queries={self.queries.value} {'needs' if sensor is None else 'makes no use of'} the sensor of"
                " another drive; give +sensor@sensors.queries=folder sensors.queries.path=DIR with study.queries=other,"
                " and neither without the other"
            )
        if sensor is None:
            return None
        plan = plan_of_trajectory(sensor, self.images, self.query_path or self.path, self.height_m)
        truth = None if self.truth is None else truth_of(self.truth, plan.keys)
        return replace(parts, sensor=sensor), plan, "queries", truth

    def _sets(self, method: Method, route: RouteMap, queries: RouteDrive) -> SetResult:
        """Sets of places by one method, and which of them hold the truth."""
        places = route.signatures(method)
        index = method.distance.prepare(places)
        field = method.distance.match(queries.signatures[method.descriptor_name], index).distance.astype(float)
        known = np.flatnonzero(np.isfinite(queries.position_m).all(axis=1))
        true = true_places(queries.position_m[known], route.position_m, route.step_m)
        tested = known
        if self.calibration is CalibrationSource.queries:
            largest = threshold(nonconformity(field[known[::2]]), true[::2], self.confidence)
            tested, true = known[1::2], true[1::2]
        else:
            between = method.distance.match(places, index).distance.astype(float)
            largest = threshold(*left_out(between, route.position_m, route.step_m), self.confidence)
        sets = place_sets(field, largest, route.position_m, self.elsewhere_steps * route.step_m)
        held = np.full(len(queries), np.nan)
        held[tested] = (sets.member[tested] & true).any(axis=1)
        return SetResult(sets, held)


class SetResult(NamedTuple):
    """Sets of places for Q queries, and which hold the truth: 1 or 0, NaN where that is not known or not tested."""

    sets: PlaceSets
    held: Floats  # (Q,)


@dataclass(frozen=True)
class RouteMap:
    """The places of a route, in order."""

    drive: RouteDrive
    step_m: float
    course: Floats  # (P,) of the route, known everywhere
    heading: Floats  # (P,) that answers are given by

    @classmethod
    def of(cls, drive: RouteDrive, course_m: float) -> RouteMap:
        """The map of some images of a drive."""
        step_m = spacing(drive.position_m)
        check_apart(drive.position_m, step_m)
        course = filled(courses(drive.position_m, max(course_m, step_m)))
        return cls(drive, step_m, course, np.where(np.isfinite(drive.heading), drive.heading, course))

    @property
    def position_m(self) -> Floats:
        """Positions (P, 3)."""
        return self.drive.position_m

    def signatures(self, method: Method) -> Any:
        """The places as a method describes them."""
        return self.drive.signatures[method.descriptor_name]

    def places(self, method: Method) -> Places:
        """The map of a method."""
        poses = planar_poses(self.position_m, self.heading)
        return Places(self.signatures(method), poses, list(self.drive.keys))

    def course_at(self, position_m: Floats) -> Floats:
        """The route's course (Q,) at the places nearest to positions (Q, 3)."""
        return np.asarray(self.course[distances_to(np.nan_to_num(position_m), self.position_m).argmin(axis=1)])


def _localizers_of(parts: Parts) -> dict[str, Localizer]:
    """The localizers under comparison, or the run's one."""
    if parts.localizers:
        return dict(parts.localizers)
    if parts.localizer is None:
        raise ConfigError(
            "the study compares localizers, and none is chosen; give localizer=NAME, or several with"
            " +localizer@localizers.ANY=NAME"
        )
    return {"localizer": parts.localizer}


def _fit(methods: list[Method], route: RouteMap, record: Recorder) -> tuple[list[Method], list[str]]:
    """The methods whose distance can compare such signatures of a camera that turns; and a sentence for each of the others."""
    fit: list[Method] = []
    unfit: list[str] = []
    for method in methods:
        try:
            prepared(method, route.signatures(method), rotated=True)
        except DataError as error:
            unfit.append(f"{method.name}: {error}")
            record.log("log", Text(unfit[-1], "WARN"))
            continue
        fit.append(method)
    if not fit:
        raise DataError(unfit[0])
    return fit, unfit


def _localize(
    methods: list[Method], localizers: dict[str, Localizer], route: RouteMap, queries: RouteDrive, record: Recorder
) -> tuple[list[RouteErrors], list[str]]:
    """Errors of every method by every localizer; and a sentence for each pair that cannot be."""
    errors: list[RouteErrors] = []
    failed: list[str] = []
    course = route.course_at(queries.position_m)
    for method in methods:
        places, signatures = route.places(method), queries.signatures[method.descriptor_name]
        degeneracy = Degeneracy(places, method.name)
        degeneracy.log_map(record)
        for name, localizer in localizers.items():
            try:
                with record.timed(f"localise: {method.name}, {name}", len(queries)):
                    found = localizer.locate(signatures, localizer.prepare(places, method.distance))
            except DataError as error:
                failed.append(f"{method.name} by {name}: {error}")
                record.log("log", Text(failed[-1], "WARN"))
                continue
            errors.append(route_errors(method.name, name, found.position_m, found.heading_rad, queries, course))
    if not errors:
        raise DataError(failed[0])
    return errors, failed


def _compasses(methods: list[Method], drive: RouteDrive) -> Iterator[Compass]:
    """The visual compass along a drive by every method whose distance gives rotations."""
    for method in methods:
        own = drive.signatures[method.descriptor_name]
        turns = []
        for i in range(1, len(drive)):
            rotation = method.distance.match(own[i : i + 1], method.distance.prepare(own[i - 1 : i])).rotation_rad
            if rotation is None:
                break
            turns.append(float(rotation[0, 0]))
        if turns:
            yield compass(method.name, np.array(turns), drive.heading)


def _log(
    record: Recorder, errors: list[RouteErrors], sets: dict[str, SetResult], route: RouteMap, queries: RouteDrive
) -> None:
    """Errors and set sizes of every query; all answers of the pair with the least median error."""
    steps = np.arange(len(queries))
    for own in errors:
        known = np.isfinite(own.error_m)
        record.log(f"error/{own.key}", Series(own.error_m[known], steps[known], queries.stamps_ns[known], "m"))
    for name, found in sets.items():
        record.log(
            f"set/{name.replace(' + ', '_')}", Series(found.sets.size.astype(float), steps, queries.stamps_ns, "places")
        )
    best = min(errors, key=lambda own: own.median_m)
    known = np.isfinite(best.error_m)
    away = distances_to(queries.position_m[known], route.position_m)
    answered = distances_to(best.answer_m[known], route.position_m).argmin(axis=1)
    verdict = verdicts(away, answered, tie_distance(route.step_m))
    record.log("answers", Answers(queries.position_m[known], best.answer_m[known], list(verdict)))


def _report(
    errors: list[RouteErrors], sets: dict[str, SetResult], compasses: list[Compass], route: RouteMap, queries: RouteDrive,
    omitted: list[str], rng: np.random.Generator, record: Recorder,
) -> Report:  # fmt: skip
    """Metrics, tables, figures."""
    own_sets, held = {n: found.sets for n, found in sets.items()}, {n: found.held for n, found in sets.items()}
    if queries.omitted is not omitted:
        omitted = list(dict.fromkeys([*omitted, *queries.omitted]))
    rows = error_rows(errors, own_sets, held)
    metrics = [
        *metrics_of(errors, own_sets, held, compasses, rng),
        Metric("places", len(route.drive), "1"),
        Metric("map_step", route.step_m, "m"),
        Metric("queries", len(queries), "1"),
        Metric("queries_with_truth", int(np.isfinite(queries.position_m).all(axis=1).sum()), "1"),
        Metric("left_out", len(omitted), "1"),
    ]
    drawn = figures.drawn(errors, own_sets, compasses, route.position_m, queries)
    record.log("errors", Image(pixels_of(drawn["errors"]), "png"))
    kept = ("method", "localizer", "position_error_median_m", "position_error_p90_m", "along_error_median_m",
            "across_error_median_m", "heading_error_median_deg", "set_size_median", "ambiguous_rate")  # fmt: skip
    short = columns_of([{name: row[name] for name in kept} for row in rows])
    tables = {"route": columns_of(rows), "queries": columns_of(query_rows(errors, own_sets, queries))}
    return Report(metrics, tables, drawn, summary=f"## Along the route\n\n{markdown(short)}", omitted=omitted)
