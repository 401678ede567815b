"""Images of a world, from a camera's rays, the faces as the camera sees them, and the atlas of their pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from omnilab.projection import RayCamera
from omnilab_mirror.rays import rays_of
from omnilab_mirror.tracer import trace, view_from
from omnilab_mirror.world import World


def render(
    world: World, camera: RayCamera, T_world_camera: npt.NDArray[Any], samples: int, color: bool
) -> npt.NDArray[np.uint8]:
    """Images (N, H, W) or (N, H, W, 3) from poses (N, 4, 4), each pixel the mean of `samples` rays."""
    if world.meshes:
        return world.embree.images(camera, T_world_camera, samples, color)
    atlas = world.color if color else world.gray
    corner = np.array([face.corner for face in world.faces])
    edges = np.array([(face.u, face.v) for face in world.faces])
    view = view_from(T_world_camera, corner, edges, atlas.size)
    images = np.empty((len(T_world_camera), camera.height, camera.width, 3 if color else 1), np.uint8)
    trace(*rays_of(camera, samples), view, atlas, images)
    return images if color else images[..., 0]
