from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

BEGIN_NS = 1_700_000_000_000_000_000
SIZE = (20, 64)  # rows, columns: of panoramas
Messages = Sequence[tuple[str, int, Any]]  # topic, record time and message
WriteLog = Callable[..., Path]


class Ros:
    """Messages of one ROS, made by the types of an independent library."""

    def __init__(self, version: int) -> None:
        self.version = version
        self.store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
        if version == 1:  # its store lacks tf2
            self.store.register(
                get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage")
            )
        self.types = self.store.types

    def of(self, kind: str, **fields: Any) -> Any:
        return self.types[kind.replace("/", "/msg/")](**fields)

    def header(self, stamp_ns: int, frame: str) -> Any:
        stamp = self.of("builtin_interfaces/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
        extra = {"seq": 7} if self.version == 1 else {}
        return self.of("std_msgs/Header", stamp=stamp, frame_id=frame, **extra)

    def image(
        self,
        pixels: np.ndarray,
        stamp_ns: int,
        encoding: str = "mono8",
        frame: str = "cam",
        pad: int = 0,
        **changed: Any,
    ) -> Any:
        height, width = pixels.shape[:2]
        rows = pixels.reshape(height, -1).view(np.uint8)
        data = np.pad(rows, ((0, 0), (0, pad))).ravel()
        fields = {"height": height, "width": width, "step": rows.shape[1] + pad, "data": data} | changed
        return self.of(
            "sensor_msgs/Image", header=self.header(stamp_ns, frame), encoding=encoding, is_bigendian=0, **fields
        )

    def compressed(self, data: bytes, stamp_ns: int, format: str = "jpeg", frame: str = "cam") -> Any:
        content = np.frombuffer(data, np.uint8)
        return self.of("sensor_msgs/CompressedImage", header=self.header(stamp_ns, frame), format=format, data=content)

    def info(
        self, size: tuple[int, int], focal_px: float, frame: str = "cam", model: str = "plumb_bob", **changed: Any
    ) -> Any:
        height, width = size
        K = np.array([focal_px, 0, width / 2, 0, focal_px, height / 2, 0, 0, 1])
        names = {"D": np.zeros(5), "K": K, "R": np.eye(3).ravel(), "P": np.eye(3, 4).ravel()} | changed
        case = str.upper if self.version == 1 else str.lower
        region = self.of("sensor_msgs/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
        return self.of(
            "sensor_msgs/CameraInfo", header=self.header(BEGIN_NS, frame), height=height, width=width,
            distortion_model=model, binning_x=0, binning_y=0, roi=region, **{case(name): value for name, value in names.items()},
        )  # fmt: skip

    def transform(
        self, parent: str, child: str, position: Sequence[float], xyzw: Sequence[float], stamp_ns: int
    ) -> Any:
        vector = self.of("geometry_msgs/Vector3", **dict(zip("xyz", map(float, position), strict=True)))
        turn = self.of("geometry_msgs/Quaternion", **dict(zip("xyzw", map(float, xyzw), strict=True)))
        pose = self.of("geometry_msgs/Transform", translation=vector, rotation=turn)
        return self.of(
            "geometry_msgs/TransformStamped", header=self.header(stamp_ns, parent), child_frame_id=child, transform=pose
        )

    def tf(self, *transforms: Any) -> Any:
        return self.of("tf2_msgs/TFMessage", transforms=list(transforms))

    def pose(self, position: Sequence[float], xyzw: Sequence[float]) -> Any:
        point = self.of("geometry_msgs/Point", **dict(zip("xyz", map(float, position), strict=True)))
        turn = self.of("geometry_msgs/Quaternion", **dict(zip("xyzw", map(float, xyzw), strict=True)))
        return self.of("geometry_msgs/Pose", position=point, orientation=turn)

    def odometry(self, position: Sequence[float], xyzw: Sequence[float], stamp_ns: int, child: str = "base") -> Any:
        zero = self.of("geometry_msgs/Vector3", x=0.0, y=0.0, z=0.0)
        twist = self.of("geometry_msgs/Twist", linear=zero, angular=zero)
        pose = self.of("geometry_msgs/PoseWithCovariance", pose=self.pose(position, xyzw), covariance=np.zeros(36))
        moved = self.of("geometry_msgs/TwistWithCovariance", twist=twist, covariance=np.zeros(36))
        return self.of(
            "nav_msgs/Odometry", header=self.header(stamp_ns, "odom"), child_frame_id=child, pose=pose, twist=moved
        )

    def write(self, path: Path, messages: Messages, storage: str = "db3", packed: str = "") -> Path:
        """A bag: .bag of ROS 1 (packed: lz4 or bz2), a folder of ROS 2 with .db3 or .mcap (packed: storage)."""
        serialize = self.store.serialize_ros1 if self.version == 1 else self.store.serialize_cdr
        writer: Any = (
            Writer1(path)
            if self.version == 1
            else Writer2(
                path, version=8, storage_plugin=StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
            )
        )
        if packed:
            mode = getattr(Writer1.CompressionFormat, packed.upper()) if self.version == 1 else None
            if mode is None:
                from rosbags.rosbag2 import CompressionFormat

                writer.set_compression(CompressionMode[packed.upper()], CompressionFormat.ZSTD)
            else:
                writer.set_compression(mode)
        with writer:
            connections: dict[str, Any] = {}
            for topic, record_ns, message in messages:
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, message.__msgtype__, typestore=self.store)
                writer.write(connections[topic], record_ns, serialize(message, message.__msgtype__))
        return path


@cache
def of_version(version: int) -> Ros:
    """Its types are compiled but once."""
    return Ros(version)


@pytest.fixture
def ros1(tmp_path: Path) -> tuple[Ros, Callable[..., Path]]:
    """The messages of ROS 1, and what writes a bag of them."""
    maker = of_version(1)
    return maker, lambda messages, name="drive": maker.write(tmp_path / f"{name}.bag", messages)


@pytest.fixture(params=["ros1", "db3", "mcap"])
def ros(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Ros, Callable[..., Path]]:
    """The messages of a ROS, and what writes a bag of them, in each kind of bag."""
    kind = request.param
    maker = of_version(1 if kind == "ros1" else 2)

    def write(messages: Messages, name: str = "drive", **settings: Any) -> Path:
        path = tmp_path / (f"{name}.bag" if kind == "ros1" else name)
        return maker.write(path, messages, storage=kind, **settings)

    return maker, write


@pytest.fixture
def pictures() -> np.ndarray:
    """Eight random pictures."""
    return np.random.default_rng(6).integers(0, 255, (8, *SIZE), np.uint8)
