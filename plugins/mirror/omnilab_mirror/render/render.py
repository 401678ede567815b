"""Rendering: images and depths of a world from a camera's rays, by the tracer of quads or, with meshes, by Embree."""

from __future__ import annotations

import numpy as np

from omnilab.api import Bytes, Floats
from omnilab.cameras import CentralCamera, RayCamera
from omnilab_mirror.render.atlas import Atlas
from omnilab_mirror.render.prepared_world import color_atlas, embree_of, gray_atlas
from omnilab_mirror.render.rays import rays_of
from omnilab_mirror.render.tracer import View, trace, view_around, view_from
from omnilab_mirror.scene.world import World


def render(world: World, camera: RayCamera, T_world_camera: Floats, samples: int, color: bool) -> Bytes:
    """Images (N, H, W) or (N, H, W, 3) from poses (N, 4, 4), each pixel the mean of `samples` rays."""
    if world.meshes:
        return embree_of(world).images(camera, T_world_camera, samples, color)
    atlas = color_atlas(world) if color else gray_atlas(world)
    view = _view(world, camera, T_world_camera, atlas)
    images = np.empty((len(T_world_camera), camera.height, camera.width, 3 if color else 1), np.uint8)
    trace(*rays_of(camera, samples), view, atlas, images)
    return images if color else images[..., 0]


def depth_of(world: World, camera: RayCamera, T_world_camera: Floats) -> Floats:
    """Metres (N, H, W) along the rays of the pixels' centres to what they meet, infinity where that is nothing."""
    if world.meshes:
        return embree_of(world).depths(camera, T_world_camera)
    depth = np.empty((len(T_world_camera), camera.height, camera.width), np.float32)
    trace(*rays_of(camera, 1), _view(world, camera, T_world_camera, gray_atlas(world)), None, depth)
    return depth


def _view(world: World, camera: RayCamera, T_world_camera: Floats, atlas: Atlas) -> View:
    """The quads as the camera sees them from poses (N, 4, 4)."""
    corner = np.array([quad.corner for quad in world.quads])
    edges = np.array([(quad.u, quad.v) for quad in world.quads])
    seen_from = view_from if isinstance(camera, CentralCamera) else view_around
    return seen_from(T_world_camera, corner, edges, atlas.size[: len(world.quads)])
