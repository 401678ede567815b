"""Images of a world, from a camera's rays, the faces as the camera sees them, and the atlas of their pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from omnilab.api import Floats
from omnilab.cameras import CentralCamera, RayCamera
from omnilab_mirror.render.atlas import Atlas
from omnilab_mirror.render.rays import rays_of
from omnilab_mirror.render.tracer import View, trace, view_around, view_from
from omnilab_mirror.scene.world import World


def render(
    world: World, camera: RayCamera, T_world_camera: npt.NDArray[Any], samples: int, color: bool
) -> npt.NDArray[np.uint8]:
    """Images (N, H, W) or (N, H, W, 3) from poses (N, 4, 4), each pixel the mean of `samples` rays."""
    if world.meshes:
        return world.embree.images(camera, T_world_camera, samples, color)
    atlas = world.color if color else world.gray
    view = _view(world, camera, T_world_camera, atlas)
    images = np.empty((len(T_world_camera), camera.height, camera.width, 3 if color else 1), np.uint8)
    trace(*rays_of(camera, samples), view, atlas, images)
    return images if color else images[..., 0]


def depth_of(world: World, camera: RayCamera, T_world_camera: npt.NDArray[Any]) -> Floats:
    """Metres (N, H, W) along the rays of the pixels' centres to what they meet, infinity where that is nothing."""
    if world.meshes:
        return world.embree.depths(camera, T_world_camera)
    depth = np.empty((len(T_world_camera), camera.height, camera.width), np.float32)
    trace(*rays_of(camera, 1), _view(world, camera, T_world_camera, world.gray), None, depth)
    return depth


def _view(world: World, camera: RayCamera, T_world_camera: npt.NDArray[Any], atlas: Atlas) -> View:
    """The faces as the camera sees them from poses (N, 4, 4)."""
    corner = np.array([face.corner for face in world.faces])
    edges = np.array([(face.u, face.v) for face in world.faces])
    seen_from = view_from if isinstance(camera, CentralCamera) else view_around
    return seen_from(T_world_camera, corner, edges, atlas.size[: len(world.faces)])
