"""Embree's tree of triangles, built and queried by the C functions of Embree 4.

The package embreex brings the library, but it copies a mesh number by number in Python, and sends one ray after the
other. Here the corners stay where they are, and eight rays are sent at once: they meet the same triangles at the same
distances, bit for bit. Neighbouring rays of a camera are sent as coherent: Embree tries them against boxes all together.
Where such a ray meets the edge of a triangle within rounding (some 1e-7 of the triangle), it may meet the neighbour at the
same distance, or miss a rim: of 133 million rays 30 and 3 did.
"""

from __future__ import annotations

import ctypes
from typing import Any, NamedTuple
from weakref import finalize

import numba
import numpy as np
import numpy.typing as npt
from embreex import rtcore_scene
from numba import types
from numba.core.cgutils import ir
from numba.extending import intrinsic

from omnilab.errors import DataError
from omnilab_mirror.compiled import compiled, compiled_parallel
from omnilab_mirror.scene.meshes.corners import is_padded, padded

Array = npt.NDArray[Any]
LANES = 8  # rays of a packet: wider ones are only fast where processors have AVX-512
# rows of a packet, which is Embree's RTCRayHit8, and behind it which lanes are used
ORIGIN, NEAR, DIRECTION, TIME, FAR, MASK, ID, FLAGS, U, V, TRIANGLE, MESH, INSTANCE, USED = (
    0, 3, 4, 7, 8, 9, 10, 11, 15, 16, 17, 18, 19, 21,
)  # fmt: skip
ROWS = 22
ALIGNMENT = 32  # bytes, of a packet
FARTHEST = 1e37
NONE = -1
ROBUST, TRIANGLES, INDICES, CORNERS = 4, 0, 0, 1  # RTCSceneFlags, RTCGeometryType, RTCBufferType
INTEGERS, FLOATS = 0x5003, 0x9003  # RTCFormat, of three each
RAYS_AT_ONCE = 4096  # of one thread
# RTCIntersectArguments: RTC_RAY_QUERY_FLAG_COHERENT, all features, and none of its functions
COHERENT = np.array([1 << 16, 0xFFFFFFFF, *[0] * 8], np.uint32)


_POINTER, _NUMBER, _SIZE = ctypes.c_void_p, ctypes.c_uint, ctypes.c_size_t
_FUNCTIONS: dict[str, tuple[Any, list[Any]]] = {  # result and arguments
    "rtcNewDevice": (_POINTER, [ctypes.c_char_p]),
    "rtcGetDeviceError": (_NUMBER, [_POINTER]),
    "rtcReleaseDevice": (None, [_POINTER]),
    "rtcNewScene": (_POINTER, [_POINTER]),
    "rtcSetSceneFlags": (None, [_POINTER, _NUMBER]),
    "rtcCommitScene": (None, [_POINTER]),
    "rtcReleaseScene": (None, [_POINTER]),
    "rtcNewGeometry": (_POINTER, [_POINTER, _NUMBER]),
    "rtcSetSharedGeometryBuffer": (None, [_POINTER, _NUMBER, _NUMBER, _NUMBER, _POINTER, _SIZE, _SIZE, _SIZE]),
    "rtcCommitGeometry": (None, [_POINTER]),
    "rtcAttachGeometry": (_NUMBER, [_POINTER, _POINTER]),
    "rtcReleaseGeometry": (None, [_POINTER]),
}


def _library() -> ctypes.CDLL:
    found = ctypes.CDLL(rtcore_scene.__file__)  # linked to Embree's library, whose names it has, too
    for name, (result, arguments) in _FUNCTIONS.items():
        function = getattr(found, name)
        function.restype, function.argtypes = result, arguments
    return found


_EMBREE = _library()


class EmbreeCall(NamedTuple):
    """Addresses for compiled code: of Embree's function, of a tree, and of how to go through it."""

    function: int
    scene: int
    arguments: int


class Tree:
    """A tree of triangles. Their corners are not copied if they are `padded`."""

    def __init__(self, corners: Array) -> None:
        """`corners`: (T, 3, 3) float32, metres."""
        self._corners = corners
        if not is_padded(corners):
            self._corners = padded(corners.shape)
            self._corners[:] = corners
        self._index = np.arange(3 * len(corners), dtype=np.uint32)
        device = _EMBREE.rtcNewDevice(None)
        if not device:
            raise DataError(
                f"Embree does not run here (its error {_EMBREE.rtcGetDeviceError(None)}); render worlds without meshes"
            )
        scene = _EMBREE.rtcNewScene(device)
        finalize(self, _release, scene, device)
        _EMBREE.rtcSetSceneFlags(scene, ROBUST)
        mesh = _EMBREE.rtcNewGeometry(device, TRIANGLES)
        for kind, form, buffer in ((CORNERS, FLOATS, self._corners), (INDICES, INTEGERS, self._index)):
            _EMBREE.rtcSetSharedGeometryBuffer(mesh, kind, 0, form, buffer.ctypes.data, 0, 12, buffer.size // 3)
        _EMBREE.rtcCommitGeometry(mesh)
        _EMBREE.rtcAttachGeometry(scene, mesh)
        _EMBREE.rtcReleaseGeometry(mesh)
        _EMBREE.rtcCommitScene(scene)
        if error := _EMBREE.rtcGetDeviceError(device):
            raise MemoryError(
                f"Embree has no tree of {len(corners)} triangles (its error {error}): it needs more memory"
            )
        function = ctypes.cast(_EMBREE.rtcIntersect8, ctypes.c_void_p).value or 0
        self.call = EmbreeCall(function, scene, 0)
        self.coherent = EmbreeCall(function, scene, COHERENT.ctypes.data)

    def meet(self, origin: Array, direction: Array) -> tuple[Array, Array]:
        """Which triangles (R,) rays (R, 3) meet first, -1 where they meet none, and after how many lengths of `direction`."""
        origin, direction = (np.ascontiguousarray(a, np.float32) for a in (origin, direction))
        triangle, distance = np.empty(len(origin), np.int32), np.empty(len(origin), np.float32)
        _meet(self.call, origin, direction, triangle, distance)
        return triangle, distance


def _release(scene: int, device: int) -> None:
    _EMBREE.rtcReleaseScene(scene)
    _EMBREE.rtcReleaseDevice(device)


# ------------------------------------------------------------------------------------------------------ compiled code
@intrinsic  # type: ignore[untyped-decorator]
def _call(_typing: Any, _function: Any, _used: Any, _scene: Any, _packet: Any, _arguments: Any) -> Any:
    """Call a C function of four pointers: numba keeps no code that holds an address itself."""

    def code(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        pointer = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [pointer] * 4).as_pointer()
        builder.call(builder.inttoptr(values[0], kind), [builder.inttoptr(value, pointer) for value in values[1:]])
        return context.get_dummy_value()

    return types.void(*[types.intp] * 5), code


@compiled
def new_packet() -> tuple[Array, Array, int]:
    """Room for a packet: rows of LANES numbers (ROWS, LANES) float32, the same as int32, and where it is."""
    numbers = np.empty(ROWS * LANES + ALIGNMENT // 4, np.float32)
    first = (-numbers.ctypes.data) % ALIGNMENT // 4
    packet = numbers[first : first + ROWS * LANES].reshape(ROWS, LANES)
    packet[:] = 0
    whole = packet.view(np.int32)
    whole[MASK], whole[INSTANCE], whole[USED] = NONE, NONE, NONE
    return packet, whole, packet.ctypes.data


@compiled
def cast(call: EmbreeCall, packet: Array, whole: Array, start: int, count: int) -> None:
    """Find what the first `count` rays of a packet meet, whose rows ORIGIN and DIRECTION (of three each) are filled.

    Then FAR, U and V are the distance and the weights of the second and third corner, and TRIANGLE, as integers, says of which
    triangle, -1: none.
    """
    for k in range(LANES):
        packet[FAR, k] = FARTHEST
        whole[TRIANGLE, k], whole[MESH, k] = NONE, NONE
    for k in range(count, LANES):
        whole[USED, k] = 0
    _call(call.function, start + USED * LANES * 4, call.scene, start, call.arguments)


@compiled_parallel
def _meet(call: EmbreeCall, origin: Array, direction: Array, triangle: Array, distance: Array) -> None:
    for part in numba.prange((len(origin) + RAYS_AT_ONCE - 1) // RAYS_AT_ONCE):
        packet, whole, address = new_packet()
        end = min((part + 1) * RAYS_AT_ONCE, len(origin))
        for first in range(part * RAYS_AT_ONCE, end, LANES):
            count = min(LANES, end - first)
            for k in range(count):
                for i in range(3):
                    packet[ORIGIN + i, k], packet[DIRECTION + i, k] = origin[first + k, i], direction[first + k, i]
            cast(call, packet, whole, address, count)
            for k in range(count):
                triangle[first + k], distance[first + k] = whole[TRIANGLE, k], packet[FAR, k]
