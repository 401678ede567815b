"""The study `views`: images from chosen poses, their panoramas, and point clouds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    Bytes,
    Floats,
    Frames,
    Image,
    Metric,
    Parts,
    PathPoses,
    PlaceMap,
    PointCloud,
    Pose,
    Recorder,
    Report,
    Tick,
    check_settings,
    setting,
)
from omnilab.cameras import RayCamera
from omnilab.errors import ConfigError
from omnilab.geometry import poses, rotation_xyz
from omnilab.image import panorama, point_cloud, to_color
from omnilab_studies.common.frames import deliver
from omnilab_studies.common.logs import start_logs
from omnilab_studies.common.tables import markdown_table
from omnilab_studies.datasets.views import figures
from omnilab_studies.datasets.views.layout import layout_of

FIGURE_3_10 = [  # the thesis's, from a place that is clear in both rooms: up by 0.4 m, 1.5 m aside, rotated by 60 and 50 degrees
    [0.0, -1.5, 1.0, 0.0, 0.0, 0.0],
    [0.0, -1.5, 1.4, 0.0, 0.0, 0.0],
    [1.5, -1.5, 1.4, 0.0, 0.0, 0.0],
    [1.5, -1.5, 1.4, 0.0, 0.0, 60.0],
    [1.5, -1.5, 1.4, 0.0, 50.0, 60.0],
]


@dataclass
class Views:
    """Images from chosen poses, with all six degrees of freedom (Berenguer, thesis, figures 3.10 to 3.13).

    A pose is [x, y, z, rx, ry, rz]: metres, and degrees about the axes, R = Rx Ry Rz (eq. 3.11). A sensor with the
    depth of its pixels (`sensor.depth=true`) also gives the point cloud that an RGB-D camera would.
    """

    poses: list[Any] = setting(FIGURE_3_10)  # see above
    panoramas: bool = True  # also unwrap the images
    cloud_points: int = setting(
        50_000, at_least=1, at_most=50_000_000
    )  # at most so many points of each view go into the logs and the figure

    needs: ClassVar[tuple[str, ...]] = ("sensor",)
    metric_names: ClassVar[tuple[str, ...]] = ("views", "gray_level_mean", "cloud_points")

    def __post_init__(self) -> None:
        check_settings(self, "study.")
        wrong = [pose for pose in self.poses if not _is_pose(pose)]
        if wrong or not self.poses:
            raise ConfigError(
                f"study.poses={wrong or self.poses} are no poses; give a list of [x, y, z, rx, ry, rz], metres and degrees"
            )

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Take an image at every pose; log it with its panorama and its point cloud."""
        start_logs(record, layout_of(self.panoramas), parts.sensor)
        values = np.array(self.poses, float)
        T_world_camera = poses(values[:, :3], rotation_xyz(*np.deg2rad(values[:, 3:].T)))
        record.log("poses", PlaceMap(T_world_camera[:, :3, 3]))

        images: list[Bytes] = []
        unwrapped: list[Bytes] = []
        clouds: list[PointCloud] = []
        for frames in deliver(parts, parts.sensor.plan(PathPoses(T_world_camera)), record, "views"):
            images += list(frames.images)
            unwrapped += list(panorama(frames.images, frames.camera)[:, :, ::-1]) if self.panoramas else []
            clouds += self._clouds(frames, rng)
            _log(record, frames, unwrapped[-len(frames) :], clouds[-len(frames) :])
        return self._report(images, unwrapped, clouds)

    def _report(self, images: list[Bytes], unwrapped: list[Bytes], clouds: list[PointCloud]) -> Report:
        metrics = _metrics(images, clouds)
        drawn: dict[str, Any] = {"views": figures.views(images, unwrapped, self.poses)}
        if clouds:
            drawn["cloud"] = figures.cloud(clouds[0].points_m, clouds[0].colors)
        return Report(metrics, {}, drawn, summary=_summary(metrics, self.poses))

    def _clouds(self, frames: Frames, rng: np.random.Generator) -> list[PointCloud]:
        """The points of each frame's pixels, at most `cloud_points` drawn at random; none without depth, pose or calibration."""
        if frames.depth_m is None or frames.T_world_camera is None or not isinstance(frames.camera, RayCamera):
            return []
        clouds = []
        for image, depth_m, T in zip(to_color(frames.images), frames.depth_m, frames.T_world_camera, strict=True):
            points = point_cloud(depth_m, frames.camera, T)
            known = np.flatnonzero(np.isfinite(points).all(-1))
            kept = np.sort(rng.permutation(known)[: self.cloud_points])
            clouds.append(PointCloud(points.reshape(-1, 3)[kept], image.reshape(-1, 3)[kept]))
        return clouds


def _is_pose(pose: Any) -> bool:
    """Whether a value is six finite numbers: OmegaConf takes integers for no floats, so the field's type cannot check it."""
    return (
        isinstance(pose, list) and len(pose) == 6 and all(isinstance(v, int | float) and np.isfinite(v) for v in pose)
    )


def _log(record: Recorder, frames: Frames, unwrapped: list[Bytes], clouds: list[PointCloud]) -> None:
    """Log a batch: images, poses, panoramas, clouds."""
    for i, image in enumerate(frames.images):
        tick = Tick(int(frames.plan_index[i]), int(frames.stamps_ns[i]))
        record.log("view/image", Image(image), tick)
        if frames.T_world_camera is not None:
            record.log("camera", Pose(frames.T_world_camera[i]), tick)
        if unwrapped:
            record.log("view/panorama", Image(unwrapped[i]), tick)
        if clouds:
            record.log("cloud", clouds[i], tick)


def _metrics(images: list[Bytes], clouds: list[PointCloud]) -> list[Metric]:
    levels: Floats = np.array([image.mean() for image in images])
    return [
        Metric("views", len(images), "1"),
        Metric("gray_level_mean", float(levels.mean()), "1"),
        Metric("cloud_points", sum(len(cloud.points_m) for cloud in clouds), "1"),
    ]


def _summary(metrics: list[Metric], poses: list[list[float]]) -> str:
    rows = [f"| {i} | {' | '.join(f'{value:g}' for value in pose)} |" for i, pose in enumerate(poses)]
    head = ["", "| step | x [m] | y [m] | z [m] | rx [°] | ry [°] | rz [°] |", "|---|---|---|---|---|---|---|"]
    return "\n".join([markdown_table(metrics, "Views"), *head, *rows])
