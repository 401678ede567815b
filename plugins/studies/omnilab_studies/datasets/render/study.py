"""The study `render`: a data set of images with poses, calibration, depth and a point cloud."""

from __future__ import annotations

import math
from contextlib import closing
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    Camera,
    Image,
    Ints,
    NamedPath,
    Parts,
    PathPoses,
    PlaceMap,
    Plan,
    Pose,
    PoseRequest,
    RandomPoses,
    RecordedPoses,
    Recorder,
    Report,
    Text,
    Tick,
    check_settings,
    setting,
)
from omnilab.cameras import RayCamera
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import heading_of
from omnilab.image import panorama
from omnilab.trajectory import plausibility
from omnilab.trajectory.files import read_trajectory
from omnilab_studies.common.dataset_files import DataSet, contents_of, default_settings
from omnilab_studies.common.grids import grid_poses
from omnilab_studies.common.image_columns import check_heights, check_positions, column_poses
from omnilab_studies.common.logs import start_logs
from omnilab_studies.datasets.render.dataset_writer import RenderedFrames, RenderedPart, RenderJob, render_plan
from omnilab_studies.datasets.render.layout import LAYOUT
from omnilab_studies.datasets.render.point_cloud import cloud_of, write_ply
from omnilab_studies.datasets.render.results import report_of

FRAME_NS = 100_000_000  # between images that were not recorded
STEP_M = 0.4
COUNT = 100
HEIGHTS_M = (0.1, 2.0, 0.1)
MOST_POINTS = 50_000_000


class Where(Enum):
    """Where images are taken."""

    grid = "grid"  # rows and columns at one height
    column = "column"  # floor positions at many heights
    path = "path"  # poses of a file
    random = "random"
    recorded = "recorded"  # all that the sensor recorded


SETTINGS = {  # of each layout
    Where.grid: {"step_m", "every", "extent_m", "height_m"},
    Where.column: {"positions_m", "heights_m"},
    Where.path: {"path", "height_m"},
    Where.random: {"count", "heading_step_deg", "extent_m", "height_m"},
    Where.recorded: set[str](),
}


@dataclass
class Render:
    """Writes a data set: images, poses with 6 degrees of freedom, calibration and, where the sensor has it, depth.

    `layout=grid` takes step_m or every, extent_m, height_m; `column` positions_m, heights_m; `path` a path of the world or a file of poses;
    `random` count, heading_step_deg, extent_m, height_m; `recorded` all that a recording holds. An unfinished data set is
    resumed: the same command again renders what is missing, another one in the same folder is refused. Disturbances are
    applied to the images. The files are described in docs/datasets.md; the sensor `folder` reads them.
    """

    folder: str = setting("???", writes=True)  # of the data set: new, or one begun with the same settings
    layout: Where = Where.grid  # or column, path, random, recorded
    step_m: float | None = setting(None, above=0)  # of the grid; null: 0.4
    every: int | None = setting(None, at_least=1)  # grid: each n-th row and column of a recording
    extent_m: list[float] | None = setting(
        None, above=0, count=2
    )  # x and y size of the area; null: all that the sensor covers
    height_m: float | None = setting(None, at_least=-1e6, at_most=1e6)  # of the viewpoint; null: the sensor's own
    positions_m: list[Any] | None = setting(None)  # [[x, y], ...] of columns; null: the world's origin
    heights_m: list[float] | None = setting(None, count=3)  # [lowest, highest, step] of columns; null: [0.1, 2.0, 0.1]
    path: str | None = None  # of the world, by its name; or a file (.txt, .tum: TUM's format; .csv: with a header)
    count: int | None = setting(None, at_least=1, at_most=1_000_000)  # of random poses; null: 100
    heading_step_deg: float | None = setting(
        None, at_least=1e-6, at_most=180
    )  # random headings are multiples of it; null: any heading
    cloud_points: int = setting(
        0, at_least=0, at_most=MOST_POINTS
    )  # at most, of cloud.ply; 0: no cloud. Needs a sensor with depth
    processes: int = setting(1, at_least=1, at_most=1024)  # that render at the same time, to the same bytes
    show: int = setting(20, at_least=0)  # images that go into the logs

    needs: ClassVar[tuple[str, ...]] = ("sensor",)
    metric_names: ClassVar[tuple[str, ...]] = ("images", "left_out", "bytes_per_image", "cloud_points")

    def __post_init__(self) -> None:
        check_settings(self, "study.")
        self._check_layout()
        if self.step_m is not None and (not 0 < self.step_m < math.inf or self.every is not None):
            raise ConfigError(
                f"study.step_m={self.step_m} with study.every={self.every} makes no grid; give one of them, above 0"
            )
        if self.heights_m is not None:
            check_heights(self.heights_m)
        check_positions(self.positions_m)

    def _check_layout(self) -> None:
        """ConfigError for a setting of another layout."""
        for name in sorted(set[str]().union(*SETTINGS.values()) - SETTINGS[self.layout]):
            if (value := getattr(self, name)) is not None:
                owner = " or ".join(where.value for where, names in SETTINGS.items() if name in names)
                raise ConfigError(
                    f"study.{name}={value} means nothing to study.layout={self.layout.value}; leave it out, or give"
                    f" study.layout={owner}"
                )
        if self.layout is Where.path and self.path is None:
            raise ConfigError(
                "study.layout=path and study.path is null; give a path of the world or FILE, in TUM's format or a CSV"
            )

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Plan, render what is missing, write poses and calibration, measure."""
        start_logs(record, LAYOUT, parts.sensor)
        layout, stamps_ns = self._pose_request(int(rng.integers(2**32)))
        plan = parts.sensor.plan(layout)
        seed = int(rng.integers(2**32))  # of the disturbances
        contents = contents_of(parts, plan, seed)
        data = DataSet(Path(self.folder))
        data.open(contents, {"sensor": default_settings(parts.sensor)})
        if plan.T_world_camera is not None:
            record.log("places", PlaceMap(plan.T_world_camera[:, :3, 3], heading_of(plan.T_world_camera)))

        recorded = self.layout is Where.recorded
        rendered = RenderedFrames(recorded, _stamps(stamps_ns, len(plan)))
        job = RenderJob(data, parts.sensor, parts.disturbances, seed, self.cloud_points > 0, recorded)
        self._render(job, plan, rendered, record)

        camera = rendered.known_camera(plan)
        data.write_poses(rendered.numbers, plan, rendered.stamps_ns, self._cells(plan))
        if recorded and plan.T_world_camera is None:
            data.write_stamps(rendered.numbers, rendered.stamps_ns)
        cloud_points = self._write_cloud(data, rendered.numbers, camera, plan) if self.cloud_points else None
        data.close(contents, rendered.about(camera))
        return report_of(data, rendered, plan, cloud_points)

    def _render(self, job: RenderJob, plan: Plan, rendered: RenderedFrames, record: Recorder) -> None:
        """Render what is missing of a plan, and write the camera as soon as it is known."""
        with closing(render_plan(job, plan, self.processes)) as parts:
            for part in record.track(parts, "images", len(plan)):
                if not rendered.parts:
                    job.data.check_room(part.numbers, len(plan))
                if rendered.camera is None and part.camera is not None:
                    record.log("log", Text(job.data.write_camera(part.camera)))
                rendered.add(part)
                self._show(record, job.data, plan, part, rendered)

    def _pose_request(self, seed: int) -> tuple[PoseRequest, Ints | None]:
        """The poses that the settings describe, and when each is taken where a file has that."""
        step_m = STEP_M if self.step_m is None and self.every is None else self.step_m
        grid = grid_poses(step_m, self.every, self.extent_m, self.height_m)
        match self.layout:
            case Where.grid:
                return grid, None
            case Where.column:
                return PathPoses(column_poses(self.positions_m or [[0.0, 0.0]], self.heights_m or HEIGHTS_M)), None
            case Where.path:
                if Path(str(self.path)).suffix == "":
                    return NamedPath(str(self.path), self.height_m), None
                trajectory = read_trajectory(Path(str(self.path)))
                plausibility.warn(str(self.path), trajectory)
                return PathPoses(trajectory.T_world_camera), trajectory.stamps_ns
            case Where.random:
                step = None if self.heading_step_deg is None else math.radians(self.heading_step_deg)
                return RandomPoses(self.count or COUNT, seed, step, grid.extent_m, self.height_m), None
            case Where.recorded:
                return RecordedPoses(), None

    def _cells(self, plan: Plan) -> Ints | None:
        """Column and row (N, 2) of each frame of a grid with a step."""
        if self.layout is not Where.grid or self.every is not None or plan.T_world_camera is None:
            return None
        xy = plan.T_world_camera[:, :2, 3]
        return np.asarray(np.rint((xy - xy.min(0)) / (self.step_m or STEP_M)), int)

    def _show(self, record: Recorder, data: DataSet, plan: Plan, part: RenderedPart, rendered: RenderedFrames) -> None:
        """Log some frames: image, panorama, pose."""
        if self.show == 0:
            return
        every = -(-len(plan) // self.show)
        for n in part.numbers[part.numbers % every == 0].tolist():
            pixels, tick = data.read(n), Tick(n, int(rendered.stamps_ns[n]))
            record.log("image", Image(pixels), tick)
            if rendered.camera is not None:
                record.log("panorama", Image(panorama(pixels[None], rendered.camera)[0][:, ::-1]), tick)
            if plan.T_world_camera is not None:
                record.log("camera", Pose(plan.T_world_camera[n]), tick)

    def _write_cloud(self, data: DataSet, numbers: Ints, camera: Camera, plan: Plan) -> int:
        """Write cloud.ply; how many points it has."""
        if not isinstance(camera, RayCamera) or plan.T_world_camera is None:
            raise DataError(
                f"study.cloud_points={self.cloud_points} asks for a point cloud, which takes a calibrated camera and poses;"
                " give study.cloud_points=0"
            )
        points = cloud_of(data, numbers, camera, plan.T_world_camera, self.cloud_points)
        write_ply(data.folder / "cloud.ply", points)
        return len(points)


def _stamps(stamps_ns: Ints | None, count: int) -> Ints:
    """When frames are taken (N,): as given for each of them, or else ten a second."""
    return FRAME_NS * np.arange(count) if stamps_ns is None or len(stamps_ns) != count else stamps_ns
