"""The methods of components whose results are kept on disk: what decides a row of them, and which arrays it is."""

from __future__ import annotations

import hashlib
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from omnilab.api import Array, Bytes, Camera, Descriptor, Floats, Renderer, Rendering, Signatures, Trainable, is_cached
from omnilab.runner.cache.row_store import KEY_BYTES, ArrayKind, Arrays, Parts


class KeptMethod(ABC):
    """One method: its arguments, of which a row each is kept, and its results as arrays of as many rows."""

    name: ClassVar[str]
    of: ClassVar[type[Any]]  # the Protocol of components that have it
    parts: ClassVar[Parts]  # the arrays of a result
    made: ClassVar[str]  # what was done to an image that was not known
    share: ClassVar[float]  # of the limit that one run may use
    spare_bytes: ClassVar[int]  # that stay free on the disk

    @abstractmethod
    def keys(self, component: Any, *given: Any) -> list[bytes]:
        """The digest of each row: of all that decides it beside the component's fingerprint."""

    @abstractmethod
    def rows(self, which: Any, *given: Any) -> tuple[Any, ...]:
        """Some rows of the arguments."""

    @abstractmethod
    def arrays(self, result: Any) -> dict[str, Any] | None:
        """A result's arrays; None where it is of another kind."""

    @abstractmethod
    def result(self, arrays: Arrays) -> Any:
        """The reverse."""

    def sound(self, result: Any, count: int) -> Arrays | None:
        """The arrays (`count`, ...) of a result, None where a file cannot hold them: the study is to find what is wrong.

        Arrays come back in C order; another order could change the last bits of sums over them.
        """
        arrays = self.arrays(result)
        is_sound = arrays is not None and all(
            type(a) is np.ndarray and len(a) == count and a.flags.c_contiguous and not self.parts[name].complaint(a)
            for name, a in arrays.items()
        )
        return arrays if is_sound else None


class KeptDescriptions(KeptMethod):
    """`describe` of descriptors, by the images' pixels."""

    name, of, made, share, spare_bytes = "describe", Descriptor, "described", math.inf, 0
    parts: ClassVar[Parts] = {
        "place": ArrayKind(np.float32, (2, 32), "NaN or infinity", np.isfinite),
        "heading": ArrayKind(np.float32, (2, 32), "NaN or infinity", np.isfinite, optional=True),
    }

    def keys(self, component: Any, images: Bytes) -> list[bytes]:  # noqa: ARG002
        """By type, shape and pixels."""
        kind = f"{images.dtype.str} {images.shape[1:]} ".encode()
        return [_digest(kind + image.tobytes()) for image in images]

    def rows(self, which: Any, images: Bytes) -> tuple[Any, ...]:
        """Some images."""
        return (images[which],)

    def arrays(self, result: Any) -> dict[str, Any] | None:
        """Place, and heading where it is an array of its own."""
        return _there(place=result.place, heading=result.heading) if isinstance(result, Signatures) else None

    def result(self, arrays: Arrays) -> Signatures:
        """The signatures."""
        return Signatures(arrays["place"], arrays.get("heading"))


class KeptRenderings(KeptMethod):
    """`render` of virtual cameras, by what their `render_keys` say.

    Images take much room: of the limit a run uses a half, since one that makes more would throw away its first ones for its
    last, and other runs' signatures, too; and what a run writes beside them must not find the disk full.
    """

    name, of, made, share, spare_bytes = "render", Renderer, "rendered", 0.5, 10**9
    parts: ClassVar[Parts] = {
        "images": ArrayKind(np.uint8, (3, 4)),
        "depth_m": ArrayKind(np.float32, (3, 3), "distances below 0, or NaN", lambda depth: depth >= 0, optional=True),
    }

    def keys(self, component: Any, world: Any, camera: Camera, T_world_camera: Floats) -> list[bytes]:
        """As the sensor says, and by each bit of the pose."""
        keys = component.render_keys(world, camera, T_world_camera)
        return [_digest(key.encode() + pose.tobytes()) for key, pose in zip(keys, T_world_camera, strict=True)]

    def rows(self, which: Any, world: Any, camera: Camera, T_world_camera: Floats) -> tuple[Any, ...]:
        """Some poses."""
        return world, camera, T_world_camera[which]

    def arrays(self, result: Any) -> dict[str, Any] | None:
        """Images, and depths where there are any."""
        return _there(images=result.images, depth_m=result.depth_m) if isinstance(result, Rendering) else None

    def result(self, arrays: Arrays) -> Rendering:
        """The images."""
        return Rendering(arrays["images"], arrays.get("depth_m"))


def kept_method(component: Any) -> KeptMethod | None:
    """The method of a component whose results are kept; None for one without, that learns, or says `cached = False`."""
    if isinstance(component, Trainable) or not is_cached(type(component)):
        return None
    return next((method for method in METHODS if isinstance(component, method.of)), None)


METHODS: Sequence[KeptMethod] = (KeptDescriptions(), KeptRenderings())


def _there(**arrays: Array | None) -> dict[str, Any]:
    return {name: array for name, array in arrays.items() if array is not None}


def _digest(content: bytes) -> bytes:
    return hashlib.sha256(content).digest()[:KEY_BYTES]
