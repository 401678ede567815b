"""Ray tracing of triangles with Embree, for worlds with meshes."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from omnilab.api import Bytes, Floats
from omnilab.cameras import RayCamera
from omnilab_mirror.render.atlas import Atlas, build_atlas
from omnilab_mirror.render.embree_tree import LANES, RAYS_AT_ONCE, Tree
from omnilab_mirror.render.ray_waves import Bundle
from omnilab_mirror.render.rays import rays_of
from omnilab_mirror.render.shading import Lighting, measure, render
from omnilab_mirror.render.triangle_table import table_of
from omnilab_mirror.scene.light import Illumination
from omnilab_mirror.scene.meshes.triangles import Triangles

Array = npt.NDArray[Any]
# not straight up, so that walls around a corner differ, too
SKYWARD = np.array([1.0, 2.0, 4.0]) / np.sqrt(21.0)
BLACK = np.zeros((1, 1, 3), np.uint8)
TILE = LANES // 2, 2  # pixels whose rays are one packet: width and height


class Embree:
    """Triangles in Embree's tree, with what shading needs."""

    def __init__(self, triangles: Triangles, light: Illumination, sky: Bytes | None) -> None:
        self.triangles, self.sky = triangles, BLACK if sky is None else sky
        self.tree = Tree(triangles.corners)
        lamps = [(*lamp.at, lamp.power, lamp.reach_m) for lamp in light.lamps]
        self.light = Lighting(light.ambient, light.skylight * SKYWARD, np.array(lamps, float).reshape(-1, 5))
        self._surfaces: dict[bool, tuple[Array, Atlas]] = {}

    def surface(self, color: bool) -> tuple[Array, Atlas]:
        """Table of the triangles and atlas of their pictures and the sky, made once for grey and once for colour."""
        if color not in self._surfaces:
            atlas = build_atlas([*self.triangles.pictures, self.sky], color)
            self._surfaces[color] = table_of(self.triangles, atlas.size, color), atlas
        return self._surfaces[color]

    def images(self, camera: RayCamera, T_world_camera: Floats, samples: int, color: bool) -> Bytes:
        """Images (N, H, W) or (N, H, W, 3) from poses (N, 4, 4), each pixel the mean of `samples` rays."""
        (table, atlas), tinted = self.surface(color), self.triangles.tinted
        bundle = bundle_of(camera, samples)
        images = np.zeros((len(T_world_camera), camera.height * camera.width, 3 if color else 1), np.uint8)
        for T, image in zip(T_world_camera.astype(np.float32), images, strict=True):
            render(bundle, T[:3, :3], T[:3, 3], samples, self.tree.coherent, table, tinted, self.light, atlas, image)
        shape = (len(images), camera.height, camera.width)
        return images.reshape(*shape, 3) if color else images.reshape(shape)

    def depths(self, camera: RayCamera, T_world_camera: Floats) -> Floats:
        """Metres (N, H, W) float32 along the ray of each pixel's centre; inf where it meets nothing."""
        bundle = bundle_of(camera, 1)
        depths = np.full((len(T_world_camera), camera.height * camera.width), np.inf, np.float32)
        for T, depth in zip(T_world_camera.astype(np.float32), depths, strict=True):
            measure(bundle, T[:3, :3], T[:3, 3], self.tree.coherent, depth)
        return depths.reshape(-1, camera.height, camera.width)


@lru_cache(maxsize=4)
def bundle_of(camera: RayCamera, samples: int) -> Bundle:
    """The rays of a camera with `samples` in each pixel, tile by tile."""
    found = rays_of(camera, samples)
    v, u = np.divmod(np.arange(camera.height * camera.width), camera.width)
    order = np.lexsort((u, v, u // TILE[0], v // TILE[1]))
    rays = found.rays.reshape(len(order), samples, 4)[order]
    used = np.any(rays[..., :3] != 0, axis=-1)
    pixel = np.repeat(order, used.sum(axis=1))
    direction, solid_angle = rays[used][:, :3].astype(np.float32), rays[used][:, 3].astype(np.float32)
    origin = None
    if found.starts is not None:
        starts = found.starts.reshape(len(order), samples, 3)[order][used]
        origin = np.ascontiguousarray(starts.astype(np.float32).T)
    first = np.nonzero(np.diff(pixel, prepend=-1))[0]  # rays with which pixels begin
    near = np.searchsorted(first, np.arange(0, len(pixel), RAYS_AT_ONCE))
    return Bundle(pixel, np.ascontiguousarray(direction.T), solid_angle, origin, np.unique([*first[near], len(pixel)]))
