"""Ray tracing of triangles with Embree, for worlds with meshes; a second thread shades the image before."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from omnilab.api import Bytes, Floats
from omnilab.cameras import RayCamera
from omnilab_mirror.render.atlas import LUMA, Atlas, build_atlas
from omnilab_mirror.render.rays import rays_of
from omnilab_mirror.render.shading import Hits, Lighting, Surface, shade, turn
from omnilab_mirror.scene.light import Illumination
from omnilab_mirror.scene.meshes.triangles import Triangles

Array = npt.NDArray[Any]
RAYS_AT_ONCE = 500_000
# not straight up, so that walls around a corner differ, too
SKYWARD = np.array([1.0, 2.0, 4.0]) / np.sqrt(21.0)
BLACK = np.zeros((1, 1, 3), np.uint8)


class Bundle(NamedTuple):
    """R rays of a camera, in its frame, float32."""

    pixel: Array  # (R,) row by row
    direction: Array  # (R, 3)
    solid_angle: Array  # (R,) of the pixel
    origin: Array | None  # (R, 3) metres; None: all start at the viewpoint


class Embree:
    """Triangles in Embree's tree, with what shading needs."""

    def __init__(self, triangles: Triangles, light: Illumination, sky: Bytes | None) -> None:
        self.triangles, self.sky = triangles, BLACK if sky is None else sky
        self.scene = EmbreeScene()
        TriangleMesh(self.scene, triangles.corners)
        lamps = [(*lamp.at, lamp.power, lamp.reach_m) for lamp in light.lamps]
        self.light = Lighting(light.ambient, light.skylight * SKYWARD, np.array(lamps, float).reshape(-1, 5))
        self._surfaces: dict[bool, tuple[Surface, Atlas]] = {}

    def meet(self, origin: Array, direction: Array) -> dict[str, Array]:
        """What rays (R, 3) meet first: `primID` (-1: nothing), `tfar`, and the weights `u`, `v` of two corners."""
        contiguous = (np.ascontiguousarray(a, np.float32) for a in (origin, direction))
        found: dict[str, Array] = self.scene.run(*contiguous, output=1)
        return found

    def surface(self, color: bool) -> tuple[Surface, Atlas]:
        """Surface and atlas for shading, made once for grey and once for colour."""
        if color not in self._surfaces:
            self._surfaces[color] = surface_of(self.triangles, self.sky, color)
        return self._surfaces[color]

    def trace(self, bundle: Bundle, T_world_camera: Floats) -> Hits:
        """What a bundle's rays meet from a pose (4, 4)."""
        R, at = T_world_camera[:3, :3].astype(np.float32), T_world_camera[:3, 3].astype(np.float32)
        direction, origin = np.empty_like(bundle.direction), np.empty_like(bundle.direction)
        turn(bundle.direction, R, direction)
        if bundle.origin is None:
            origin[:] = at
        else:
            turn(bundle.origin, R, origin)
            origin += at
        met = self.meet(origin, direction)
        return Hits(bundle.pixel, origin, direction, bundle.solid_angle, met["primID"], met["tfar"], met["u"], met["v"])

    def images(self, camera: RayCamera, T_world_camera: Floats, samples: int, color: bool) -> Bytes:
        """Images (N, H, W) or (N, H, W, 3) from poses (N, 4, 4), each pixel the mean of `samples` rays."""
        surface, atlas = self.surface(color)
        images = np.zeros((len(T_world_camera), camera.height * camera.width, 3 if color else 1), np.uint8)
        jobs: list[Future[None]] = []
        with ThreadPoolExecutor(1) as shader:
            for T, image in zip(T_world_camera, images, strict=True):
                for bundle in bundles_of(camera, samples):
                    hits = self.trace(bundle, T)
                    jobs.append(shader.submit(shade, hits, samples, surface, self.light, atlas, image))
                    if len(jobs) > 2:  # hits are large
                        jobs.pop(0).result()
            for job in jobs:
                job.result()
        shape = (len(images), camera.height, camera.width)
        return images.reshape(*shape, 3) if color else images.reshape(shape)

    def depths(self, camera: RayCamera, T_world_camera: Floats) -> Floats:
        """Metres (N, H, W) float32 along the ray of each pixel's centre; inf where it meets nothing."""
        depths = np.full((len(T_world_camera), camera.height * camera.width), np.inf, np.float32)
        for T, depth in zip(T_world_camera, depths, strict=True):
            for bundle in bundles_of(camera, 1):
                hits = self.trace(bundle, T)
                depth[bundle.pixel] = np.where(hits.triangle < 0, np.inf, hits.distance)
        return depths.reshape(-1, camera.height, camera.width)


def surface_of(triangles: Triangles, sky: Bytes, color: bool) -> tuple[Surface, Atlas]:
    """The triangles' and the sky's pictures at all resolutions, and where each triangle is in them.

    In grey images a tint and a picture are multiplied as grey levels.
    """
    atlas = build_atlas([*triangles.pictures, sky], color)
    normals, area = triangles.normals, np.linalg.norm(triangles.normals, axis=1)
    x, y = np.moveaxis(triangles.uv[:, 1:] - triangles.uv[:, :1], -1, 0)
    share = np.abs(x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0])  # of the picture, doubled as the area is
    density = share * atlas.size[triangles.picture] / area
    tint = triangles.colors if np.any(triangles.colors < 255) else triangles.colors[:0]
    if not color:
        tint = np.rint(tint @ LUMA).astype(np.uint8)[..., None]
    unit = (normals / area[:, None]).astype(np.float32)
    return Surface(triangles.uv, unit, density.astype(np.float32), triangles.picture, triangles.painted, tint), atlas


@lru_cache(maxsize=4)
def bundles_of(camera: RayCamera, samples: int) -> list[Bundle]:
    """The rays of a camera with `samples` in each pixel, in parts of bounded size, each of whole pixels."""
    found = rays_of(camera, samples)
    rays = found.rays.reshape(camera.height * camera.width, samples, -1)
    origins = None if found.starts is None else found.starts.reshape(len(rays), samples, 3)
    step = max(1, RAYS_AT_ONCE // samples)
    parts = [slice(i, i + step) for i in range(0, len(rays), step)]
    return [_bundle(part.start, rays[part], None if origins is None else origins[part]) for part in parts]


def _bundle(first: int, rays: Array, origins: Array | None) -> Bundle:
    used = np.any(rays[..., :3] != 0, axis=-1)
    pixel = (first + np.nonzero(used)[0]).astype(np.int64)
    direction, solid_angle = rays[used][:, :3].astype(np.float32), rays[used][:, 3].astype(np.float32)
    return Bundle(pixel, direction, solid_angle, None if origins is None else origins[used].astype(np.float32))
