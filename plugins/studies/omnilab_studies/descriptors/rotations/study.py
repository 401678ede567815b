"""Rotations about any axis between two images, by several methods."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    Array,
    Bytes,
    Floats,
    Frames,
    GridPoses,
    Image,
    Ints,
    Metric,
    Parts,
    PathPoses,
    PlaceMap,
    Plan,
    Pose,
    RecordedPoses,
    Recorder,
    Report,
    Sensor,
    Series,
    Signatures,
    Tick,
    check_settings,
    setting,
)
from omnilab.cameras import EquirectangularCamera, reproject
from omnilab.cameras.sphere import sphere
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import poses, rotation_xyz
from omnilab.metrics import bootstrap
from omnilab_studies.common.describing import describe
from omnilab_studies.common.frames import deliver, disturbed
from omnilab_studies.common.grids import extent_of
from omnilab_studies.common.logs import start_logs
from omnilab_studies.common.methods import Method, descriptors_of, fitted_all, joined_signatures, key_of, methods_of
from omnilab_studies.common.pose_sources import Source, changed
from omnilab_studies.common.scores import known_poses
from omnilab_studies.common.tables import columns_of, markdown
from omnilab_studies.descriptors.rotations import figures
from omnilab_studies.descriptors.rotations.layout import LAYOUT
from omnilab_studies.descriptors.rotations.pairs import (
    Pairs,
    angle_of,
    heading_and_tilt,
    pairs_of,
    random_rotations,
    rooms_of,
)

PAIR_NS = 100_000_000  # between two pairs, in the logs


@dataclass
class Rotations:
    """The rotation between two images, all three angles of it, against how far apart they were taken.

    Pairs of places at each of `distances_m`; the reference upright, the query rotated at random, so that its z axis tilts
    by at most `largest_tilt_deg` (180: uniform on SO(3); 0: headings alone). Every method, a descriptor with a distance,
    answers the rotation of its match; one that gives headings alone answers an upright one. The error is the angle of
    the rotation that is left; of it also the heading (the twist about z) and the tilt. Recorded images are paired as they
    are, by their poses, each two of them once, and with `room` only within a room. With `query_sensor` the queries show a
    changed world: `{variant: evening}`.
    """

    distances_m: list[float] = setting([0.0, 0.25, 0.5, 1.0, 2.0], at_least=0, fewest=1)  # between the two images
    pairs: int = setting(24, at_least=1, at_most=100_000)  # of each distance
    slack_m: float = setting(0.05, at_least=0)  # of the distances
    largest_tilt_deg: float = setting(180.0, at_least=0, at_most=180)  # of a query's z axis
    images: Source = Source.grid  # or recorded
    room: str | None = (
        None  # of recorded images: a regular expression for what names the room in their names; null: any pair
    )
    step_m: float = setting(0.25, above=0)  # of the grid of places
    extent_m: list[float] | None = setting(
        None, above=0, count=2
    )  # x and y size of the grid; null: all that the sensor covers
    height_m: float | None = setting(None, at_least=-1e6, at_most=1e6)  # of the viewpoint; null: the sensor's own
    query_sensor: dict[str, Any] = setting({})  # {setting of the sensor: value} of the queries
    within_deg: float = setting(10.0, above=0, at_most=180)  # an answer is right with a smaller error
    show: int = setting(20, at_least=0)  # pairs whose images go into the logs

    needs: ClassVar[tuple[str, ...]] = ("sensor",)
    metric_names: ClassVar[tuple[str, ...]] = (
        "METHOD_rotation_error_median", "METHOD_heading_error_median", "METHOD_tilt_error_median", "METHOD_right_rate",
        "METHOD_DISTANCE_rotation_error_median", "METHOD_DISTANCE_heading_error_median", "pairs",
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_settings(self, "study.")
        if self.images not in (Source.grid, Source.recorded):
            raise ConfigError(f"study.images={self.images.value} is not possible here; give grid or recorded")
        if self.room is not None and self.images is Source.grid:
            raise ConfigError(
                f"study.room={self.room!r} is about names of recorded images; give study.images=recorded, too"
            )

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Draw pairs, describe both images of each, estimate the rotation between them, compare with the truth."""
        start_logs(record, LAYOUT, parts.sensor)
        plan, pairs, seed = self._pairs(parts.sensor, rng)
        references, queries, query_sensor = self._plans(parts.sensor, plan, pairs, rng)
        record.log("places", PlaceMap(known_poses(plan.T_world_camera, "images")[:, :3, 3]))
        parts = fitted_all(parts, references, record)
        methods = methods_of(parts)
        before, first = _described(methods, parts, references, record, "references", None)
        after, second = _described(methods, replace(parts, sensor=query_sensor), queries, record, "queries", seed)

        T_reference, T_query = (known_poses(p.T_world_camera, "images") for p in (references, queries))
        truth = np.swapaxes(T_reference[:, :3, :3], -1, -2) @ T_query[:, :3, :3]
        found = {m.name: _rotations(m, before[m.descriptor_name], after[m.descriptor_name], record) for m in methods}
        left = {name: np.swapaxes(truth, -1, -2) @ R for name, R in found.items()}
        poses_of = {"reference_camera": T_reference, "camera": T_query}
        self._log(record, first, second, poses_of, found[methods[0].name], left)

        rows = [_row(name, d, R[pairs.distance_m == d]) for name, R in left.items() for d in self.distances_m]
        errors = {name: np.rad2deg(angle_of(R)) for name, R in left.items()}
        return Report(
            [*self._metrics(left, rng), *_by_distance(rows), Metric("pairs", len(truth), "1")],
            {"rotations": columns_of(rows)},
            {"rotations": figures.against_distance(rows), "distribution": figures.distribution(errors)},
            summary=f"## Rotations\n\n{markdown(columns_of([_short(row) for row in rows]))}",
            omitted=plan.omitted,
        )

    def _pairs(self, sensor: Sensor, rng: np.random.Generator) -> tuple[Plan, Pairs, int]:
        """The places, pairs of them, and a seed for the disturbances."""
        recorded = self.images is Source.recorded
        grid = GridPoses(self.step_m, None, extent_of(self.extent_m), self.height_m)
        plan = sensor.plan(RecordedPoses() if recorded else grid)
        rooms = None if self.room is None else rooms_of(plan.keys, self.room)
        pairs = pairs_of(plan, self.distances_m, self.pairs, self.slack_m, rng, rooms, once=recorded)
        return plan, pairs, int(rng.integers(2**32))

    def _plans(self, sensor: Sensor, plan: Plan, pairs: Pairs, rng: np.random.Generator) -> tuple[Plan, Plan, Sensor]:
        """The plans of references and queries, pair by pair, and the queries' sensor."""
        query_sensor = changed(sensor, "study.query_sensor", self.query_sensor) if self.query_sensor else sensor
        references, queries = plan.at(pairs.reference), plan.at(pairs.query)
        if self.images is Source.grid:
            position_m = known_poses(queries.T_world_camera, "images")[:, :3, 3]
            R = random_rotations(len(queries), np.deg2rad(self.largest_tilt_deg), rng)
            queries = query_sensor.plan(PathPoses(poses(position_m, R)))
        return references, queries, query_sensor

    def _log(
        self, record: Recorder, first: Bytes, second: Bytes, poses_of: Mapping[str, Floats], found: Floats,
        left: Mapping[str, Floats],
    ) -> None:  # fmt: skip
        """Some pairs as spheres, with the query's rotation undone by the first method, and errors of all pairs."""
        steps = np.arange(len(found))
        for name, R in left.items():
            record.log(f"error/{key_of(name)}", Series(np.rad2deg(angle_of(R)), steps, PAIR_NS * steps, "deg"))
        every = max(1, -(-len(found) // self.show)) if self.show else len(found) + 1
        for i in steps[::every] if self.show else []:
            tick = Tick(int(i), int(PAIR_NS * i))
            camera = EquirectangularCamera(second.shape[2], second.shape[1])
            undone = reproject(second[i : i + 1], camera, camera, found[i].T)
            for path, picture in (("reference", first[i]), ("query", second[i]), ("undone", undone[0])):
                record.log(path, Image(np.ascontiguousarray(picture[:, ::-1])), tick)  # as a person sees it
            for path, T_world_camera in poses_of.items():
                record.log(path, Pose(T_world_camera[i]), tick)

    def _metrics(self, left: Mapping[str, Floats], rng: np.random.Generator) -> list[Metric]:
        """Errors of each method over all pairs, with intervals, and the share of right answers."""
        found = []
        for name, R in left.items():
            errors = {
                "rotation": angle_of(R),
                "heading": np.abs(heading_and_tilt(R)[0]),
                "tilt": heading_and_tilt(R)[1],
            }
            for what, radians in errors.items():
                degrees = np.rad2deg(radians)
                interval = bootstrap(partial(_over, np.median, degrees), len(degrees), rng)
                found.append(Metric(f"{key_of(name)}_{what}_error_median", float(np.median(degrees)), "deg", interval))
            right = np.rad2deg(errors["rotation"]) < self.within_deg
            interval = bootstrap(partial(_over, np.mean, right), len(right), rng)
            found.append(Metric(f"{key_of(name)}_right_rate", float(right.mean()), "1", interval))
        return found


def _over(statistic: Callable[[Any], Any], values: Array, chosen: Ints) -> float:
    """A statistic of some of the values."""
    return float(statistic(values[chosen]))


def _described(
    methods: Sequence[Method], parts: Parts, plan: Plan, record: Recorder, stage: str, seed: int | None
) -> tuple[dict[str, Signatures], Bytes]:
    """Signatures of a plan's frames by every descriptor, and the frames as spheres; queries are disturbed."""
    batches: dict[str, list[Signatures]] = {name: [] for name in descriptors_of(methods)}
    spheres = []
    for frames in deliver(parts, plan, record, stage):
        _check_complete(frames)
        shown = frames if seed is None else disturbed(frames, parts.disturbances, seed)
        spheres.append(sphere(shown.images, shown.camera))
        for name, descriptor in descriptors_of(methods).items():
            batches[name].append(describe(descriptor, shown, record))
    return {name: joined_signatures(own) for name, own in batches.items()}, np.concatenate(spheres)


def _rotations(method: Method, before: Signatures, after: Signatures, record: Recorder) -> Floats:
    """R_reference_query (N, 3, 3) of pairs of signatures by a method, each pair compared alone."""
    found = np.empty((len(before), 3, 3))
    for i in range(len(before)):
        with record.timed(f"match: {method.name}", 1):
            match = method.distance.match(after[i : i + 1], method.distance.prepare(before[i : i + 1]))
        if match.R_place_query is not None:
            found[i] = match.R_place_query[0, 0]
        elif match.rotation_rad is not None:
            found[i] = rotation_xyz(0.0, 0.0, float(match.rotation_rad[0, 0]))
        else:
            raise ConfigError(
                f"the distance '{method.distance_name}' of {method.descriptor_name} gives no rotation; choose another, such as"
                " so3_correlation with spherical_harmonics"
            )
    return found


def _check_complete(frames: Frames) -> None:
    """DataError for frames that the sensor could not deliver: pairs go by their number."""
    if frames.omitted:
        raise DataError(f"an image of a pair could not be read: {frames.omitted[0]}; take it out of the recording")


def _row(method: str, distance_m: float, left: Floats) -> dict[str, Any]:
    """Errors of a method's pairs at one distance, from the rotations (n, 3, 3) that are left of the truth."""
    heading, tilt = heading_and_tilt(left)
    degrees = {"rotation": np.rad2deg(angle_of(left)), "heading": np.rad2deg(np.abs(heading)), "tilt": np.rad2deg(tilt)}
    quantiles = {"q25": 0.25, "median": 0.5, "q75": 0.75}
    return {"method": method, "distance_m": distance_m, "pairs": len(left)} | {
        f"{what}_error_{q}_deg": float(np.quantile(values, share))
        for what, values in degrees.items()
        for q, share in quantiles.items()
    }


def _short(row: Mapping[str, Any]) -> dict[str, Any]:
    """The columns of the summary."""
    return {name: value for name, value in row.items() if not name.endswith(("q25_deg", "q75_deg"))}


def _by_distance(rows: Sequence[Mapping[str, Any]]) -> list[Metric]:
    """The median errors of each method at each distance."""
    return [
        Metric(f"{key_of(row['method'])}_{row['distance_m']:g}m_{what}_error_median", row[f"{what}_error_median_deg"], "deg")
        for row in rows
        for what in ("rotation", "heading")
    ]  # fmt: skip
