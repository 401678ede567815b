"""What sensors that render their images offer beside, so that these are kept on disk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from omnilab.api.data import Bytes, Camera, Floats


@dataclass(frozen=True)
class Rendering:
    """What a camera saw from N poses."""

    images: Bytes  # (N, H, W) or (N, H, W, 3)
    depth_m: Floats | None = None  # (N, H, W) float32: along each pixel's ray; inf where it meets nothing


@runtime_checkable
class Renderer(Protocol):
    """A sensor whose `frames` come from its `render`: the runner keeps on disk what that returns, image by image.

    An image is kept by the sensor's settings, the files that these name, its source code and what it imports, and by its
    key: all else that decides a pixel must be in there. `cached = False` in the class keeps none.
    """

    def render(self, world: Any, camera: Camera, T_world_camera: Floats) -> Rendering:
        """The images of a world, as the sensor loaded it, from poses (N, 4, 4); each depends on its own pose alone."""

    def render_keys(self, world: Any, camera: Camera, T_world_camera: Floats) -> Sequence[str]:
        """What is in each of these N images: the content of the world, the camera, the pose."""
