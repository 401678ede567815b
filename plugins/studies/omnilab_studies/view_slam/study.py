"""Maps of views from images: several filters on one way, beside the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    Bytes,
    Floats,
    Frames,
    Image,
    Metric,
    Motion,
    Parts,
    PathPoses,
    Plan,
    Recorder,
    Report,
    Text,
    Tick,
    Unusable,
)
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import heading_of, planar_poses
from omnilab.image import panorama
from omnilab.posegraph.graph import matrices, moved, vectors
from omnilab.trajectory.evaluation import path_length, rms
from omnilab.trajectory.files import tum_text
from omnilab_studies.common.frames import deliver_queries
from omnilab_studies.common.match_images import draw_image_pair
from omnilab_studies.common.pose_sources import Source, plan_of_trajectory
from omnilab_studies.common.samples import evenly
from omnilab_studies.common.tables import markdown_table
from omnilab_studies.view_slam import figures
from omnilab_studies.view_slam.consistency import errors, nees, nees_bounds
from omnilab_studies.view_slam.display import ODOMETRY, TRUTH, Bearings, line, show_errors, show_step
from omnilab_studies.view_slam.filter_comparison import Teller, columns, rivals_of
from omnilab_studies.view_slam.filter_runs import position_rms
from omnilab_studies.view_slam.front_end import Association, Looked, ViewMapper, agreeing
from omnilab_studies.view_slam.layout import VIEW_SLAM
from omnilab_studies.view_slam.saved_views import Keeper, check_sensors, known_views

VIEWS = "views"  # the odometry that tells the relative pose of two images
UNTOLD = np.diag([0.2, 0.2, 0.5]) ** 2  # m², rad²: of a step that odometry tells nothing of
FINE = 40  # samples of each step of a path, to space images along it


@dataclass
class ViewSlam:
    """View-based SLAM (Gil et al., 2012, 5.2): each of the `view_filters` maps the way from the same images and odometry.

    The run's `odometry` predicts; `odometries.views` tells the relative pose of two images, of which the bearing and the
    relative orientation of a view are taken. An image that shows no view well enough becomes one. Poses must be known:
    they are what is measured against, and the first is where the maps begin.

    Views from before, with their poses, come from `sensors.known`: those that a run kept, or any images of the same
    camera. Their errors are taken as independent, with `known_sigma_m` in x and y and `known_sigma_deg` in heading.
    """

    images: Source = Source.path  # or recorded: all that was recorded, in its order
    path: str = "two_rooms"  # of the world, by its name; or a file of poses (.txt, .tum: TUM's format; .csv)
    every_m: float = 0.05  # an image on a path so often
    every_rad: float = 0.05  # and whenever the robot has turned so far
    height_m: float | None = None  # of the viewpoint on a path of the world; null: the sensor's own
    keep: str | None = None  # folder for the first filter's views: images, and the poses that they were mapped at
    known_sigma_m: float = 0.05  # standard deviation of x and y of views from before
    known_sigma_deg: float = 1.0  # and of their headings
    views: Association = field(default_factory=Association)  # when an image shows a view, and when it becomes one
    show: int = 150  # images that go into the logs, and stages of the map; the numbers of all of them do

    needs: ClassVar[tuple[str, ...]] = ("sensor", "odometry")

    def __post_init__(self) -> None:
        if self.images not in {Source.path, Source.recorded}:
            raise ConfigError(f"study.images={self.images.value} makes no way; give path or recorded")
        if not (self.every_m > 0 and self.every_rad > 0):
            raise ConfigError(
                f"study.every_m={self.every_m:g}, every_rad={self.every_rad:g} space no images; give numbers above 0"
            )
        if not (0 < self.known_sigma_m < np.inf and 0 < self.known_sigma_deg < np.inf):
            raise ConfigError(
                f"study.known_sigma_m={self.known_sigma_m:g}, known_sigma_deg={self.known_sigma_deg:g} are no standard"
                " deviations; give numbers above 0"
            )
        if self.show < 1:
            raise ConfigError(f"study.show={self.show} shows nothing; give 1 or more")

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Map image by image with every filter; measure."""
        rivals = rivals_of(parts)
        if VIEWS not in parts.odometries:
            raise ConfigError("this study needs to relate two images; give +odometry@odometries.views=planar_epipolar")
        check_sensors(parts)
        plan = self._plan(parts)
        record.log("", VIEW_SLAM)
        if scene := parts.sensor.scene():
            record.log("room", scene)
        assert plan.T_world_camera is not None
        record.log("truth", line(vectors(plan.T_world_camera, planar=True), TRUTH))
        seed, base = int(rng.integers(2**32)), int(rng.integers(2**32))
        keeper = None if self.keep is None else Keeper(self.keep, parts, plan, seed, asdict(self) | {"keep": None})
        way = _Way(self, parts, rivals, record, base, set(evenly(len(plan), self.show).tolist()), keeper)
        for frames in deliver_queries(parts, plan, record, seed):
            for i in range(len(frames)):
                way.take(frames.at(i))
        if len(way.truth) < 2:
            raise DataError(f"a sequence of {len(way.truth)} image makes no way; give 2 or more")
        if keeper:
            keeper.close(next(iter(way.mappers.values())).map.views())
        return _report(way, record)

    def _plan(self, parts: Parts) -> Plan:
        """The images of the way, in their order."""
        plan = plan_of_trajectory(parts.sensor, self.images, self.path, self.height_m)
        if self.images is Source.path and plan.T_world_camera is not None and len(plan) > 1:
            plan = parts.sensor.plan(PathPoses(spaced(plan.T_world_camera, self.every_m, self.every_rad)))
        if plan.T_world_camera is None:
            raise DataError(
                "the images have no poses, and view_slam measures its maps with them; give the sensor poses"
            )
        if len(plan) < 2:
            raise DataError(f"a sequence of {len(plan)} image makes no way; give 2 or more")
        return plan


def spaced(T_world_camera: Floats, every_m: float, every_rad: float) -> Floats:
    """Poses (M, 4, 4) along a path (N, 4, 4), a next one wherever the robot has moved or turned so far."""
    count = len(T_world_camera)
    at = np.linspace(0, count - 1, FINE * (count - 1) + 1)
    number = np.arange(count)
    position = np.column_stack([np.interp(at, number, axis) for axis in T_world_camera[:, :3, 3].T])
    heading = np.interp(at, number, np.unwrap(heading_of(T_world_camera)))
    moves = np.linalg.norm(np.diff(position, axis=0), axis=1) / every_m
    along = np.append(0.0, np.cumsum(np.maximum(moves, np.abs(np.diff(heading)) / every_rad)))
    chosen = np.searchsorted(along, np.arange(int(along[-1] + 1e-9) + 1) - 1e-9)
    return planar_poses(position[chosen], heading[chosen])


class _Way:
    """The images so far, and what each filter makes of them."""

    def __init__(
        self, study: ViewSlam, parts: Parts, rivals: Mapping[str, Any], record: Recorder, base: int,
        shown: set[int], keeper: Keeper | None,
    ) -> None:  # fmt: skip
        self._parts, self._study, self._record, self._base, self._shown = parts, study, record, base, shown
        self._rng = np.random.default_rng(base)  # of odometry
        self._rivals, self._keeper = rivals, keeper
        self._wheels: Any = None  # what odometry kept of the last image
        self._looks: dict[int, Any] = {}  # of views and the present image, by number; views from before are below 0
        self._related: dict[tuple[int, int], Motion] = {}  # of the present image, whichever filter asks
        self._panoramas: dict[int, Bytes] = {}  # of the views of the first filter, which is shown
        self._teller = Teller(record)
        self.mappers: dict[str, ViewMapper] = {}
        self.seen: dict[str, list[Looked]] = {name: [] for name in rivals}
        self.odometry: list[Floats] = []
        self.truth: list[Floats] = []
        self.keys: list[str] = []
        self.stamps_ns: list[int] = []
        self.lost = 0  # steps of which odometry told nothing
        self.known = 0  # views from before

    def take(self, frame: Frames) -> None:
        """One more image, a batch of one."""
        assert frame.T_world_camera is not None
        image, record = len(self.truth), self._record
        self.truth.append(vectors(frame.T_world_camera, planar=True)[0])
        self.keys.append(frame.keys[0])
        self.stamps_ns.append(int(frame.stamps_ns[0]))
        with record.timed("odometry"):
            motion = self._motion(frame)
        with record.timed("look"):
            (look,) = self._parts.odometries[VIEWS].extract(frame)
        if isinstance(look, Unusable):
            self._teller.tell(f"image {image}, {frame.keys[0]}", [look.reason])
        self._looks[image] = look
        if image == 0:
            self._begin(frame)
        else:
            self.odometry.append(moved(self.odometry[-1], motion[0]))
        self._related.clear()
        told = (None, None) if image == 0 else motion
        for name, mapper in self.mappers.items():
            with record.timed(f"map: {name}"):
                found = mapper.take(image, look, *told)
            self.seen[name].append(found)
            self._teller.tell(f"image {image}, {name}", found.warnings)
        if next(iter(self.seen.values()))[-1].new is not None:
            self._panoramas[image] = panorama(frame.images, frame.camera)[0]
            if self._keeper:
                self._keeper.add(frame, record)
        if not any(mapper.images and mapper.images[-1] == image for mapper in self.mappers.values()):
            del self._looks[image]  # it became no view
        if image in self._shown:
            self._show(frame, image)

    def _begin(self, first: Frames) -> None:
        """Maps of nothing but views from before."""
        study, start = self._study, self.truth[0]
        self.odometry.append(start)
        self.mappers = {n: ViewMapper(f, study.views, self._relate, start) for n, f in self._rivals.items()}
        sigmas = [study.known_sigma_m, study.known_sigma_m, np.deg2rad(study.known_sigma_deg)]
        for frame in known_views(self._parts, first.camera, self._record):
            assert frame.T_world_camera is not None
            (look,) = self._parts.odometries[VIEWS].extract(frame)
            if isinstance(look, Unusable):
                self._teller.tell(f"known view {frame.keys[0]}", [look.reason])
                continue
            self.known += 1
            self._looks[-self.known] = look
            self._panoramas[-self.known] = panorama(frame.images, frame.camera)[0]
            for mapper in self.mappers.values():
                mapper.know(-self.known, vectors(frame.T_world_camera, planar=True)[0], np.diag(sigmas) ** 2)
            if self._keeper:
                self._keeper.add(frame, self._record)

    def _motion(self, frame: Frames) -> tuple[Floats, Floats]:
        """What odometry tells since the last image; as nothing but a wide step where it tells nothing."""
        (look,) = self._parts.odometry.extract(frame)
        before, self._wheels = self._wheels, look
        if before is None:
            return np.zeros(3), np.eye(3)
        told = self._parts.odometry.estimate(before, look, self._rng)
        if not told.failed:
            return told.vector, told.covariance
        self.lost += 1
        self._teller.tell(f"image {len(self.truth) - 1}, odometry", [told.failed])
        return np.zeros(3), UNTOLD

    def _relate(self, image: int, view: int) -> Motion:
        """How to get from an image to that of a view: the same whatever else is asked."""
        if (image, view) not in self._related:
            odometry, rng = self._parts.odometries[VIEWS], np.random.default_rng([self._base, image, view % 2**32])
            with self._record.timed("relate"):
                self._related[image, view] = odometry.estimate(self._looks[image], self._looks[view], rng)
        return self._related[image, view]

    def _show(self, frame: Frames, image: int) -> None:
        """The first filter's map into the logs, and the image beside the view that it shows best."""
        name, mapper = next(iter(self.mappers.items()))
        tick, found = Tick(image, self.stamps_ns[-1]), self.seen[name][-1]
        way = np.array([pose for pose, _ in mapper.poses])
        views = (mapper.map.views(), mapper.map.view_covariances())
        seen = Bearings(found.views, found.angles_rad[:, 0], found.believed)
        show_step(self._record, tick, way, views, np.array(list(found.compared), int), seen)
        self._record.log("query/image", Image(frame.images[0]), tick)
        self._record.log("odometry", line(np.array(self.odometry), ODOMETRY), tick)
        now = panorama(frame.images, frame.camera)[0]
        best = max(found.compared, key=lambda view: agreeing(found.compared[view]), default=None)
        if best is None:
            self._record.log("query/panorama", Image(draw_image_pair(now, None, None)), tick)
        else:
            kept = self._panoramas[mapper.images[best]]
            self._record.log("query/panorama", Image(draw_image_pair(now, kept, found.compared[best])), tick)


# -------------------------------------------------------------------------------------------------------------- results
def _report(way: _Way, record: Recorder) -> Report:
    """Errors and consistency of every filter, figures 8 to 10, files."""
    truth, odometry = np.array(way.truth), np.array(way.odometry)
    rows, poses, shown = [], {"odometry": odometry, "truth": truth}, {}
    for name, mapper in way.mappers.items():
        at, spread = (np.array(each) for each in zip(*mapper.poses, strict=True))
        final = mapper.map.finish()
        rows.append(_row(name, at, spread, final, truth, way.seen[name], len(mapper.images) - way.known))
        poses |= {name: at, f"{name}_final": final}
        shown[name] = figures.Mapped(at, spread, mapper.map.views(), mapper.map.view_covariances())
    first = next(iter(shown.values()))
    show_errors(record, first.poses, first.covariances, truth)
    length = float(path_length(matrices(truth))[-1])
    metrics = [
        *(Metric(f"{row['filter']}_{key}", row[key], unit) for key, unit in UNITS.items() for row in rows),
        Metric("odometry_rms", position_rms(odometry, truth), "m"),
        Metric("images", len(truth), "1"),
        Metric("path_length", length, "m"),
        Metric("lost_steps", way.lost, "1"),
        *([Metric("known_views", way.known, "1")] if way.known else []),
    ]
    record.log("summary", Text(markdown_table(metrics, "Maps of views"), markdown=True))
    stamps_ns = np.array(way.stamps_ns)
    files = {f"{name}.tum": tum_text(matrices(T), stamps_ns) for name, T in poses.items()}
    table: dict[str, Any] = {"image": np.arange(len(truth)), "key": way.keys}
    for name, at in poses.items():
        table |= {f"{name}_x_m": at[:, 0], f"{name}_y_m": at[:, 1], f"{name}_heading_deg": np.rad2deg(at[:, 2])}
    for name, seen in way.seen.items():
        table[f"{name}_observed"] = [len(found.views) for found in seen]
        table[f"{name}_believed"] = [int(found.believed.sum()) for found in seen]
    return Report(
        metrics, {"filters": columns(rows), "steps": table}, figures.mapped(truth, odometry, shown), files=files
    )


UNITS = {
    "rms": "m", "end": "m", "final_rms": "m", "heading_rms": "deg", "nees": "1", "nees_median": "1", "nees_within": "1",
    "views": "1", "observed": "1", "gated": "1",
}  # fmt: skip


def _row(
    name: str, at: Floats, spread: Floats, final: Floats, truth: Floats, seen: Sequence[Looked], views: int
) -> dict[str, Any]:
    """One filter on the way."""
    off = errors(at, truth)
    each = nees(off[1:], spread[1:])
    low, high = nees_bounds(1)
    observed = sum(len(found.views) for found in seen)
    return {
        "filter": name,
        "rms": position_rms(at, truth),
        "end": float(np.hypot(*off[-1, :2])),
        "final_rms": position_rms(final, truth),
        "heading_rms": float(np.rad2deg(rms(off[:, 2]))),
        "nees": float(each.mean()),
        "nees_median": float(np.median(each)),
        "nees_within": float(((low <= each) & (each <= high)).mean()),
        "views": views,
        "observed": observed,
        "gated": 1 - sum(int(found.believed.sum()) for found in seen) / max(1, observed),
    }
