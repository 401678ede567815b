"""A sensor: panoramas of an empty room with wavy walls, from any pose."""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from omnilab import (
    Bytes,
    DataError,
    Floats,
    Frames,
    GridPoses,
    Mesh,
    PathPoses,
    Plan,
    PoseRequest,
    RandomPoses,
    Sensor,
    check_settings,
    setting,
)
from omnilab.cameras import EquirectangularCamera
from omnilab.geometry import planar_poses
from omnilab.limits import check_work

FRAME_NS = 100_000_000  # between two images, by the sensor's clock
VERSION = 1  # raise it when the same settings and pose give another image


@dataclass
class MySensor:
    """A virtual panoramic camera in an empty room, whose walls have a grey pattern.

    The room is centred on the world's origin, its floor at height 0. A pixel's ray meets
    the nearest of the six walls, and its grey level is a sum of waves at that point.
    """

    length_m: float = setting(6.0, above=0, at_most=1000)  # of the room, along x
    width_m: float = setting(4.0, above=0, at_most=1000)  # along y
    ceiling_m: float = setting(2.5, above=0, at_most=1000)  # along z
    height_m: float = setting(1.0, above=0)  # of the camera, where a layout gives none
    rows: int = setting(64, at_least=8, at_most=4096)  # of an image
    batch: int = setting(64, at_least=1, at_most=4096)  # images at once

    def __post_init__(self) -> None:
        check_settings(self)

    @property
    def camera(self) -> EquirectangularCamera:
        """Rows evenly spaced in elevation, 60 degrees down to 60 degrees up."""
        return EquirectangularCamera(
            4 * self.rows, self.rows, lowest_deg=-60, highest_deg=60
        )

    def plan(self, layout: PoseRequest) -> Plan:
        """The layout's poses, less those outside the room, which `omitted` lists."""
        poses = self._poses(layout)
        size = np.array([self.length_m, self.width_m, self.ceiling_m])
        beyond = np.abs(poses[:, :3, 3] - [0, 0, self.ceiling_m / 2]) >= size / 2
        outside = beyond.any(axis=1)
        omitted = [f"{p.round(2)} is outside the room" for p in poses[outside, :3, 3]]
        return Plan([self._key(T) for T in poses[~outside]], poses[~outside], omitted)

    def frames(self, plan: Plan) -> Iterator[Frames]:
        """The planned images, batch by batch, ten a second by the sensor's clock."""
        poses = plan.T_world_camera
        if poses is None:
            raise DataError("this sensor images poses; give a plan of its own")
        for start in range(0, len(plan), self.batch):
            index = np.arange(start, min(start + self.batch, len(plan)))
            yield Frames(
                images=np.stack([self._image(T) for T in poses[index]]),
                keys=plan.at(index).keys,
                stamps_ns=FRAME_NS * index,
                camera=self.camera,
                plan_index=index,
                T_world_camera=poses[index],
            )

    def scene(self) -> Mesh | None:
        """What the viewer shows of the world: the floor."""
        x, y = self.length_m / 2, self.width_m / 2
        corners = np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]])
        triangles = np.array([[0, 1, 2], [0, 2, 3]])
        return Mesh(corners, triangles, np.full((4, 3), 128, np.uint8))

    def _poses(self, layout: PoseRequest) -> Floats:
        """`T_world_camera` (N, 4, 4) of a layout."""
        if isinstance(layout, PathPoses):
            return layout.T_world_camera
        if not isinstance(layout, GridPoses | RandomPoses):
            raise DataError(
                f"a room cannot be asked for {type(layout).__name__}; ask for a grid,"
                " random poses or a path"
            )
        x, y = layout.extent_m or (0.9 * self.length_m, 0.9 * self.width_m)
        height = self.height_m if layout.height_m is None else layout.height_m
        if isinstance(layout, RandomPoses):
            return _random(layout, x, y, height)
        if layout.step_m is None:
            raise DataError("a room has no images to take every n-th of; give step_m")
        count = (x / layout.step_m + 1) * (y / layout.step_m + 1)
        check_work(f"{count:.3g} poses", "give a larger step_m", memory=250 * count)
        xs, ys = (_centred(side, layout.step_m) for side in (x, y))
        return planar_poses([(px, py, height) for py in ys for px in xs])

    def _key(self, T_world_camera: Floats) -> str:
        """What names an image's content, in the cache of signatures, too."""
        content = f"{VERSION} {self} {T_world_camera.tolist()}"
        return hashlib.sha256(content.encode()).hexdigest()

    def _image(self, T_world_camera: Floats) -> Bytes:
        """The image (rows, columns) from a pose (4, 4)."""
        camera = self.camera
        v, u = np.indices((camera.height, camera.width)).astype(float)
        rays = camera.directions(np.stack([u, v], -1)) @ T_world_camera[:3, :3].T
        half = np.array([self.length_m, self.width_m, self.ceiling_m]) / 2
        origin = T_world_camera[:3, 3] - [0, 0, half[2]]  # from the room's centre
        with np.errstate(divide="ignore"):
            far = (half - np.sign(rays) * origin) / np.abs(rays)  # to each pair
        x, y, z = np.moveaxis(origin + far.min(axis=-1, keepdims=True) * rays, -1, 0)
        waves = np.sin(3 * x + y) + np.sin(5 * y - 2 * z + 1) + np.sin(4 * z + x * y)
        return np.asarray(np.rint(128 + 40 * waves), np.uint8)


def _random(layout: RandomPoses, x: float, y: float, height: float) -> Floats:
    """Random positions and headings, the same for the same seed."""
    rng = np.random.default_rng(layout.seed)
    position_m = np.full((layout.count, 3), height)
    position_m[:, :2] = rng.uniform(-0.5, 0.5, (layout.count, 2)) * [x, y]
    heading_rad = rng.uniform(0, 2 * np.pi, layout.count)
    if step_rad := layout.heading_step_rad:
        heading_rad = np.floor(heading_rad / step_rad) * step_rad
    return planar_poses(position_m, heading_rad)


def _centred(side: float, step: float) -> Floats:
    """Positions along a side, evenly around 0."""
    count = int(side / step + 1e-6) + 1
    return step * (np.arange(count) - (count - 1) / 2)


# a type checker compares it with the contract:
_: type[Sensor] = MySensor
