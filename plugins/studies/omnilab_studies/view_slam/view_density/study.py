"""How many views a map needs, by the threshold of R and the way of matching (Gil et al., 2012, 2.3 and 5.2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    Floats,
    Frames,
    Image,
    Metric,
    Parts,
    Recorder,
    Report,
    Tick,
    Unusable,
    ViewFilter,
    check_settings,
    setting,
)
from omnilab.errors import ConfigError
from omnilab.image import panorama
from omnilab.limits import check_work
from omnilab.posegraph.graph import matrices, moved, vectors
from omnilab.trajectory.evaluation import path_length
from omnilab_studies.common.frames import deliver_queries
from omnilab_studies.common.logs import start_logs
from omnilab_studies.common.match_images import draw_image_pair
from omnilab_studies.common.pose_sources import Source, check_is_trajectory
from omnilab_studies.common.samples import evenly
from omnilab_studies.common.tables import columns_of, markdown
from omnilab_studies.view_slam.display import TRUTH, Bearings, line, show_errors, show_step
from omnilab_studies.view_slam.filter_comparison import LogLimiter, simulated_filters_of
from omnilab_studies.view_slam.front_end import AssociationSettings, inlier_count
from omnilab_studies.view_slam.initialisation import Initialisation
from omnilab_studies.view_slam.layout import VIEW_DENSITY
from omnilab_studies.view_slam.mapping_run import odometry_step
from omnilab_studies.view_slam.study import ViewSlam
from omnilab_studies.view_slam.view_density import figures
from omnilab_studies.view_slam.view_density.cases import Case, MappedDrive, columns, mean_row
from omnilab_studies.view_slam.view_density.relations import Relations, binned

FEATURE_BYTES = 30_000  # of an image, at least
EDGES_M = (0.0, 0.2, 0.4, 0.7, 1.1, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 7.0, 10.0, 15.0)  # of bins of distance
SUMMARY = ("label", "threshold", "views", "rms_m", "odometry_rms_m", "heading_rms_deg", "nees", "image_ms")


@dataclass
class ViewDensity:
    """Maps of views by the threshold of R, the matching, and the rule by which images become views.

    The images of one drive are related by each of the `odometries`, and mapped by each of the `view_filters`: with each
    threshold of R (Gil et al., 2012, eq. 13) in `similarities`, and by the last of the odometries with each of `gains`,
    where views are chosen by expected information. All maps have the same `seeds` wheels. Beside it: R and the error of
    bearings against the distance of two images. Times are means over images of the processor's; tables, no metrics.
    """

    images: Source = Source.path  # or recorded: all that was recorded, in its order
    path: str = "square"  # of the world, by its name; or a file of poses (.txt, .tum: TUM's format; .csv)
    every_m: float = setting(0.05, above=0)  # an image on a path so often
    every_rad: float = setting(0.05, above=0)  # and whenever the robot has rotated so far
    height_m: float | None = setting(None, at_least=-1e6, at_most=1e6)  # of the viewpoint on a path; null: the sensor's
    similarities: list[float] = setting([0.5, 0.35, 0.25, 0.15], above=0, at_most=1, fewest=1)  # thresholds of R
    gains: list[float] = setting([0.3, 0.6, 1.2], above=0)  # thresholds of expected information, in nats
    seeds: int = setting(4, at_least=2, at_most=1000)  # wheels
    references: int = setting(6, at_least=1, at_most=1000)  # images that others are compared with, evenly on the path
    compared: int = setting(60, at_least=1, at_most=100_000)  # images that are
    views: AssociationSettings = field(
        default_factory=lambda: AssociationSettings(range_m=6.0, candidates=4)
    )  # when an image shows a view
    show: int = setting(100, at_least=1)  # images that go into the logs

    needs: ClassVar[tuple[str, ...]] = ("sensor", "odometry")
    metric_names: ClassVar[tuple[str, ...]] = (
        "METHOD_similarity_1m", "FILTER_LABEL_fewest_views", "FILTER_LABEL_fewest_rms", "FILTER_LABEL_most_views",
        "FILTER_LABEL_most_rms", "odometry_rms", "images", "path_length",
    )  # fmt: skip
    cached: ClassVar[bool] = False  # it measures time

    def __post_init__(self) -> None:
        check_settings(self, "study.")
        check_is_trajectory(self.images)

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Map one drive in every case, image by image; evaluate."""
        filters = simulated_filters_of(parts)
        if not parts.odometries:
            raise ConfigError("this study relates images; give +odometry@odometries.NAME=guided_epipolar, or several")
        if parts.sensors:
            raise ConfigError(f"sensors.{next(iter(parts.sensors))} is not used: these maps begin empty; leave it out")
        drive = ViewSlam(self.images, self.path, self.every_m, self.every_rad, self.height_m)
        plan, seed = drive.planned(parts), int(rng.integers(2**32))
        kept = min(self.references, len(plan)) * len(parts.odometries)
        check_work(f"features of {kept} images", "give fewer study.references", memory=kept * FEATURE_BYTES)
        start_logs(record, VIEW_DENSITY, parts.sensor)
        assert plan.T_world_camera is not None
        record.log("truth", line(vectors(plan.T_world_camera, planar=True), TRUTH))
        mapping = _Mapping(self, parts, filters, self._cases(parts, filters), seed, len(plan), record)
        for frames in deliver_queries(parts, plan, record, seed):
            for i in range(len(frames)):
                mapping.process(frames.at(i))
        return _report(mapping, record)

    def _cases(self, parts: Parts, filters: Mapping[str, ViewFilter]) -> list[Case]:
        """All cases: method by method, and those of information at the end."""
        methods = list(parts.odometries)
        found = [
            Case(name, method, Initialisation.similarity, threshold)
            for name in filters
            for method in methods
            for threshold in sorted(self.similarities)
        ]
        return found + [
            Case(name, methods[-1], Initialisation.information, gain) for name in filters for gain in sorted(self.gains)
        ]


class _Mapping:
    """All maps of the drive, image by image."""

    def __init__(
        self, study: ViewDensity, parts: Parts, filters: Mapping[str, ViewFilter], cases: Sequence[Case], seed: int,
        images: int, record: Recorder,
    ) -> None:  # fmt: skip
        self.relations = {name: Relations(odometry, seed) for name, odometry in parts.odometries.items()}
        self.drives = [
            [MappedDrive(case, filters[case.filter], study.views, self.relations[case.method]) for case in cases]
            for _ in range(study.seeds)
        ]
        shown = Case(
            next(iter(filters)), list(parts.odometries)[-1], Initialisation.similarity, min(study.similarities)
        )
        self.shown = self.drives[0][list(cases).index(shown)]  # that with the fewest views, most likely
        self.truth: list[Floats] = []
        self.odometry: list[list[Floats]] = [[] for _ in range(study.seeds)]
        self.range_m = study.views.range_m
        self._wheels, self._record, self._limiter = parts.odometry, record, LogLimiter(record)
        self._before: Any = None  # what the wheels have of the last image
        self._rngs = [np.random.default_rng([seed, k]) for k in range(study.seeds)]
        self._references = set(evenly(images, study.references).tolist())
        self._compared, self._shown = (set(evenly(images, n).tolist()) for n in (study.compared, study.show))
        self._pictures: dict[int, Any] = {}

    def process(self, frame: Frames) -> None:
        """One more image, a batch of one."""
        assert frame.T_world_camera is not None
        image, truth = len(self.truth), vectors(frame.T_world_camera, planar=True)[0]
        self.truth.append(truth)
        motions = self._motions(frame)
        for name, relations in self.relations.items():
            if isinstance(features := relations.extract(image, frame), Unusable):
                self._limiter.log(f"image {image}, {name}", [features.reason])
        for k, drives in enumerate(self.drives):
            self.odometry[k].append(moved(self.odometry[k][-1], motions[k][0]) if image else truth)
            for drive in drives:
                if image == 0:
                    drive.begin(truth)
                drive.process(image, motions[k] if image else (None, None))
        for relations in self.relations.values():
            if image in self._compared:
                relations.compare(image, sorted(r for r in self._references if r < image), self.truth, EDGES_M[-1])
        self._show(frame, image)
        for name, relations in self.relations.items():
            if image not in self._references and not self._is_view(image, name):
                del relations.features[image]

    def _is_view(self, image: int, method: str) -> bool:
        """Whether the last image became one in any map of a method."""
        return any(d.mapper.images[-1:] == [image] for row in self.drives for d in row if d.case.method == method)

    def _motions(self, frame: Frames) -> list[tuple[Floats, Floats]]:
        """Motions (3,) of the wheels of each seed since the last image, with their covariances (3, 3)."""
        (features,) = self._wheels.extract(frame)
        before, self._before = self._before, features
        steps = [odometry_step(self._wheels, before, features, rng) for rng in self._rngs]
        for why in dict.fromkeys(step.failed for step in steps if step.failed):
            self._limiter.log(f"image {len(self.truth) - 1}, odometry", [why])
        return [(step.vector, step.covariance) for step in steps]

    def _show(self, frame: Frames, image: int) -> None:
        """One map into the logs, and the image above the view with most inliers."""
        mapper, done = self.shown.mapper, self.shown.associations[-1]
        if done.new is not None:
            self._pictures[image] = panorama(frame.images, frame.camera)[0]
        if image not in self._shown:
            return
        tick = Tick(image, int(frame.stamps_ns[0]))
        observed = Bearings(done.views, done.angles_rad[:, 0], done.believed)
        views = (mapper.map.views(), mapper.map.view_covariances())
        trajectory = np.array([pose for pose, _ in mapper.poses])
        show_step(self._record, tick, trajectory, views, np.array(list(done.candidates), int), observed)
        self._record.log("query/image", Image(frame.images[0]), tick)
        best = max(done.candidates, key=lambda view: inlier_count(done.candidates[view]), default=None)
        below = None if best is None else self._pictures[mapper.images[best]]
        pair = draw_image_pair(
            panorama(frame.images, frame.camera)[0], below, None if best is None else done.candidates[best]
        )
        self._record.log("query/panorama", Image(pair), tick)


def _report(mapping: _Mapping, record: Recorder) -> Report:
    """Metrics, tables and figures of all maps; the errors of the one that is shown into the logs."""
    truth, wheels = np.array(mapping.truth), [np.array(each) for each in mapping.odometry]
    poses, covariances = (np.array(each) for each in zip(*mapping.shown.mapper.poses, strict=True))
    show_errors(record, poses, covariances, truth)
    drive_rows, rows = list[dict[str, Any]](), list[dict[str, Any]]()
    for c, drive in enumerate(mapping.drives[0]):
        own = [drives[c].row(truth, wheels[k]) for k, drives in enumerate(mapping.drives)]
        drive_rows += [{**columns(drive.case), "drive": k, **row} for k, row in enumerate(own)]
        rows.append(mean_row(drive.case, own))
    alike = [row for name, each in mapping.relations.items() for row in binned(name, each.pairs, EDGES_M)]
    metrics = [
        *_alike_metrics(alike), *_metrics(rows), Metric("odometry_rms", rows[0]["odometry_rms_m"], "m"),
        Metric("images", len(truth), "1"), Metric("path_length", float(path_length(matrices(truth))[-1]), "m"),
    ]  # fmt: skip
    tables = {"density": columns_of(rows), "drives": columns_of(drive_rows)}
    drawn = {"density": figures.density(rows)}
    if alike:  # no two of the images that were to be compared lie within the range, or can be described
        tables["similarity"], drawn["similarity"] = columns_of(alike), figures.similarity(alike)
    brief = columns_of([{name: row[name] for name in SUMMARY} for row in rows])
    return Report(metrics, tables, drawn, summary="\n".join(["## Maps with few views", "", markdown(brief)]))


def _alike_metrics(alike: Sequence[Mapping[str, Any]]) -> list[Metric]:
    """R at one metre, of each method whose pairs reach from nearer to farther."""
    found = []
    for name in dict.fromkeys(row["method"] for row in alike):
        at, R = np.array([(row["distance_m"], row["similarity"]) for row in alike if row["method"] == name]).T
        if at[0] <= 1 <= at[-1]:
            found.append(Metric(f"{name}_similarity_1m", float(np.interp(1.0, at, R)), "1"))
    return found


def _metrics(rows: Sequence[Mapping[str, Any]]) -> list[Metric]:
    """Views and errors of each filter's and label's maps with the fewest views and with the most."""
    found = []
    for name, label in dict.fromkeys((row["filter"], row["label"]) for row in rows):
        own = sorted(
            (row for row in rows if (row["filter"], row["label"]) == (name, label)), key=lambda row: row["views"]
        )
        for which, row in (("fewest", own[0]), ("most", own[-1])):
            found += [
                Metric(f"{name}_{label}_{which}_views", row["views"], "1"),
                Metric(f"{name}_{label}_{which}_rms", row["rms_m"], "m"),
            ]
    return found
