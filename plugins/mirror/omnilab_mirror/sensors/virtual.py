"""Base class of the virtual cameras: a world, poses in it, and the rays of a camera model traced into it."""

from __future__ import annotations

import hashlib
import os
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omnilab.api import Bytes, Floats, Frames, Ints, Mesh, Plan, PoseRequest, Rendering, check_settings, setting
from omnilab.cameras import RayCamera
from omnilab.cameras.plausibility import check_sees
from omnilab.errors import ConfigError, DataError
from omnilab.limits import check_work

if TYPE_CHECKING:
    from omnilab_mirror.scene.world import World  # which loads the textures

RENDERER_VERSION = 1  # part of the keys: raise it when the same world and pose give another picture
FRAME_NS = 100_000_000
MOST_PIXELS = 2**31  # of a batch
RAY_S = 5e-9  # of one processor for one ray, at least


@dataclass
class VirtualCamera(ABC):
    """Images a virtual world from any pose. What a subclass adds is its camera model."""

    world: str = "room"  # a shipped world's name, or the path of a YAML or mesh file (.obj, .glb, .ply)
    variant: str | None = None  # of the world: one that its file names, with another light or other objects
    color: bool = False  # RGB rather than grey
    samples: int = setting(4, at_least=1, at_most=1024)  # rays a pixel: 1, 4, 9, ... against jagged edges
    height_m: float = setting(1.0, at_least=-1e6, at_most=1e6)  # of the viewpoint, where a layout gives none
    on_floor: bool = True  # a robot carries the camera: grids and random poses keep clear of furniture below, too
    batch: int = setting(64, at_least=1, at_most=4096)  # images rendered at once
    depth: bool = False  # also how far each pixel sees
    up: str | None = None  # of a mesh file as world: its axis that points up, y or z; null: y in GLB, z in OBJ and PLY
    scale: float = setting(
        1.0, at_least=1e-6, at_most=1e6
    )  # of a mesh file as world: metres a unit of it; 0.01 where it is in centimetres

    def __post_init__(self) -> None:
        check_settings(self)
        if self.samples < 1 or int(np.sqrt(self.samples)) ** 2 != self.samples:
            raise ConfigError(f"samples={self.samples} do not fill a square; give 1, 4, 9 or another square")
        if self.up not in {None, "y", "z"}:
            raise ConfigError(f"up={self.up!r} is no axis that may point up; give y, z or null")
        camera = self.camera  # checks its settings
        largest = MOST_PIXELS // (camera.width * camera.height)
        if self.batch > largest >= 1:
            raise ConfigError(
                f"batch={self.batch} images of {camera.width} x {camera.height} pixels are held at once, more than memory"
                f" should; give batch={largest} or less"
            )
        check_sees(camera)

    @property
    @abstractmethod
    def camera(self) -> RayCamera:
        """The camera model; the origin of its frame is the pose."""

    def plan(self, layout: PoseRequest) -> Plan:
        """The layout's poses, less those inside furniture or outside the room, which `omitted` lists."""
        from omnilab_mirror.sensors.poses import poses_of

        world = self._world()
        T_world_camera, omitted = poses_of(layout, world, self.height_m, self.on_floor, self._image_s)
        return Plan(self.render_keys(world, self.camera, T_world_camera), T_world_camera, omitted)

    def frames(self, plan: Plan) -> Iterator[Frames]:
        """The planned images, ten a second by the sensor's clock."""
        if plan.T_world_camera is None:
            raise DataError("a virtual sensor cannot image a plan without poses; ask this sensor's plan() for one")
        world, camera = self._world(), self.camera
        self._check_images(len(plan))
        for start in range(0, len(plan), self.batch):
            yield self._batch(world, camera, plan, np.arange(start, min(start + self.batch, len(plan))))

    def _batch(self, world: World, camera: RayCamera, plan: Plan, index: Ints) -> Frames:
        part = plan.at(index)
        assert part.T_world_camera is not None
        seen, stamps_ns = self.render(world, camera, part.T_world_camera), FRAME_NS * (plan.first + index)
        return Frames(seen.images, part.keys, stamps_ns, camera, index, part.T_world_camera, depth_m=seen.depth_m)

    def render(self, world: World, camera: RayCamera, T_world_camera: Floats) -> Rendering:
        """What the camera sees of the world from poses (N, 4, 4), with depths where `depth` asks for them."""
        from omnilab_mirror.render.render import depth_of, render

        images = self._with_carrier(render(world, camera, T_world_camera, self.samples, self.color))
        return Rendering(images, depth_of(world, camera, T_world_camera) if self.depth else None)

    def render_keys(self, world: World, camera: RayCamera, T_world_camera: Floats) -> Sequence[str]:
        """A digest for each pose (N, 4, 4): of the world's content and variant, the camera and the pose."""
        content = (RENDERER_VERSION, world.digest, repr(camera), self.color, self.samples, *self._carrier)
        digest = hashlib.blake2b(repr(content).encode(), digest_size=12)
        keys = []
        for pose in T_world_camera + 0.0:  # -0 is 0
            key = digest.copy()
            key.update(pose.tobytes())
            keys.append(key.hexdigest())
        return keys

    def scene(self) -> Mesh:
        """The world's quads in coarse colours, open from above."""
        from omnilab_mirror.render.viewer_mesh import mesh_of

        return mesh_of(self._world())

    @classmethod
    def shipped_worlds(cls) -> list[str]:
        """The names that `world` takes beside files."""
        from omnilab_mirror.scene.shipped import shipped

        return list(shipped())

    @property
    def imaged_world(self) -> tuple[str, str]:
        """The world's name, and a digest of its content and variant."""
        return Path(self.world).stem, self._world().digest

    @property
    def _carrier(self) -> tuple[float, ...]:
        """What an image's key says of the robot that the camera sees; nothing where it sees none."""
        return ()

    def _with_carrier(self, images: Bytes) -> Bytes:
        """The images with the robot that carries the camera, where it sees any of it; they may be changed in place."""
        return images

    @property
    def _image_s(self) -> float:
        """Seconds that an image takes at least, with all processors."""
        return RAY_S * self.samples * self.camera.width * self.camera.height / (os.cpu_count() or 1)

    def _check_images(self, count: int) -> None:
        """ConfigError if so many images are too much."""
        width, height, at_once = self.camera.width, self.camera.height, min(self.batch, count)
        each = width * height * ((3 if self.color else 1) + (4 if self.depth else 0))
        what, with_ = f"images of {width} x {height} pixels", f"sensor.samples={self.samples}"
        check_work(f"{at_once} {what} at once", "give smaller ones, or a smaller sensor.batch", memory=at_once * each)
        check_work(f"{count} {what} with {with_}", "give fewer or smaller ones", seconds=count * self._image_s)

    def _world(self) -> World:
        from omnilab_mirror.scene.load import load_world

        return load_world(self.world, self.variant, self.up, self.scale)
