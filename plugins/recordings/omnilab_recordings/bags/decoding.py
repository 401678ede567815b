"""Messages of logs decoded: images, calibrations and poses, of ROS and of Foxglove, as one kind each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from omnilab.api import Floats
from omnilab.errors import DataError
from omnilab_recordings.bags.message import LogMessage
from omnilab_recordings.bags.ros_fields import RosFields

MOST_TRANSFORMS = 100_000  # in a message


@dataclass(frozen=True)
class ImageMessage:
    """An image as it was sent."""

    stamp_ns: int  # of its header; 0 where nobody filled it in
    frame: str
    encoding: str  # of pixels: mono8, bgr8, ...; of compressed data: what they are said to be
    data: memoryview
    compressed: bool
    height: int = 0
    width: int = 0
    step: int = 0  # bytes of a row
    big_endian: bool = False


@dataclass(frozen=True)
class CalibrationMessage:
    """A camera's calibration, by the names of ROS's camera_info."""

    frame: str
    values: Mapping[str, Any]


@dataclass(frozen=True)
class TransformMessage:
    """T_parent_child at a time: of a tree of frames, or of an odometry (then `child` may be empty)."""

    stamp_ns: int
    parent: str
    child: str
    position_m: Floats  # (3,)
    quaternion_xyzw: Floats  # (4,)


def kind_of(message: LogMessage) -> str:
    """The type's name without the folder that ROS 2 puts into it: sensor_msgs/Image."""
    return message.kind.replace("/msg/", "/")


def decoded_image(message: LogMessage) -> ImageMessage:
    """The image; DataError, in words that follow its name, if it is none."""
    found: ImageMessage = IMAGES[kind_of(message)](_content(message))
    return found


def decoded_calibration(message: LogMessage) -> CalibrationMessage:
    """The calibration; DataError as of `decoded_image`."""
    found: CalibrationMessage = CALIBRATIONS[kind_of(message)](_content(message))
    return found


def decoded_transforms(message: LogMessage) -> list[TransformMessage]:
    """The transforms; DataError as of `decoded_image`."""
    return list((TRANSFORMS | POSES)[kind_of(message)](_content(message)))


def is_read(kinds: Mapping[str, Any], message: LogMessage) -> bool:
    """Whether a message is of one of the kinds, and in an encoding that is read."""
    kind = kind_of(message)
    encodings = {"protobuf"} if kind.startswith("foxglove.") else {"ros1", "cdr"}
    return kind in kinds and message.encoding in encodings


def _content(message: LogMessage) -> Any:
    """What the functions below read: fields in their order, or a message of protobuf."""
    kind = kind_of(message)
    return _parsed(kind, message.data) if kind.startswith("foxglove.") else RosFields(message.data, message.encoding)


# ----------------------------------------------------------------------------------------------------------------- ROS
def _ros_image(fields: RosFields) -> ImageMessage:
    stamp_ns, frame = fields.header()
    height, width, encoding = fields.whole(), fields.whole(), fields.text()
    big_endian, step = bool(fields.whole("B")), fields.whole()
    return ImageMessage(stamp_ns, frame, encoding, fields.data(), False, height, width, step, big_endian)


def _ros_compressed(fields: RosFields) -> ImageMessage:
    stamp_ns, frame = fields.header()
    return ImageMessage(stamp_ns, frame, fields.text(), fields.data(), True)


def _ros_calibration(fields: RosFields) -> CalibrationMessage:
    _, frame = fields.header()
    values: dict[str, Any] = {"height": fields.whole(), "width": fields.whole(), "distortion_model": fields.text()}
    values |= {"D": fields.doubles().tolist(), "K": fields.doubles(9).tolist()}
    values |= {"R": fields.doubles(9).tolist(), "P": fields.doubles(12).tolist()}
    values |= {"binning_x": fields.whole(), "binning_y": fields.whole()}
    region = ("x_offset", "y_offset", "height", "width")
    values["roi"] = {name: fields.whole() for name in region}
    return CalibrationMessage(frame, values)


def _ros_transforms(fields: RosFields) -> Iterator[TransformMessage]:
    if (count := fields.whole()) > MOST_TRANSFORMS:
        raise DataError("is no list of transforms")
    for _ in range(count):
        yield _ros_transform(fields)


def _ros_transform(fields: RosFields) -> TransformMessage:
    stamp_ns, parent = fields.header()
    return TransformMessage(stamp_ns, parent, fields.text(), fields.doubles(3), fields.doubles(4))


def _ros_pose(fields: RosFields) -> Iterator[TransformMessage]:
    stamp_ns, frame = fields.header()
    yield TransformMessage(stamp_ns, frame, "", fields.doubles(3), fields.doubles(4))


# ------------------------------------------------------------------------------------------------------------ Foxglove
def _parsed(kind: str, data: memoryview) -> Any:
    """The protobuf message, by Foxglove's own definition."""
    from foxglove_schemas_protobuf import (
        CameraCalibration_pb2,
        CompressedImage_pb2,
        FrameTransform_pb2,
        FrameTransforms_pb2,
        PoseInFrame_pb2,
        RawImage_pb2,
    )
    from google.protobuf.message import DecodeError  # type: ignore[import-untyped]

    classes = {
        "foxglove.CameraCalibration": CameraCalibration_pb2.CameraCalibration,
        "foxglove.CompressedImage": CompressedImage_pb2.CompressedImage,
        "foxglove.FrameTransform": FrameTransform_pb2.FrameTransform,
        "foxglove.FrameTransforms": FrameTransforms_pb2.FrameTransforms,
        "foxglove.PoseInFrame": PoseInFrame_pb2.PoseInFrame,
        "foxglove.RawImage": RawImage_pb2.RawImage,
    }
    message = classes[kind]()
    try:
        message.ParseFromString(bytes(data))
    except DecodeError as error:
        raise DataError("is cut short") from error
    return message


def _time_ns(stamp: Any) -> int:
    return int(stamp.seconds) * 10**9 + int(stamp.nanos)


def _foxglove_image(message: Any) -> ImageMessage:
    size = {"height": message.height, "width": message.width, "step": message.step}
    data = memoryview(message.data)
    return ImageMessage(_time_ns(message.timestamp), message.frame_id, message.encoding, data, False, **size)


def _foxglove_compressed(message: Any) -> ImageMessage:
    data = memoryview(message.data)
    return ImageMessage(_time_ns(message.timestamp), message.frame_id, message.format, data, True)


def _foxglove_calibration(message: Any) -> CalibrationMessage:
    values: dict[str, Any] = {name: list(getattr(message, name)) for name in "DKRP"}
    values |= {"height": message.height, "width": message.width, "distortion_model": message.distortion_model}
    return CalibrationMessage(message.frame_id, values)


def _foxglove_transforms(message: Any) -> Iterator[TransformMessage]:
    return (one for part in message.transforms for one in _foxglove_transform(part))


def _foxglove_transform(message: Any) -> Iterator[TransformMessage]:
    names = message.parent_frame_id, message.child_frame_id
    yield TransformMessage(_time_ns(message.timestamp), *names, *_pose(message.translation, message.rotation))


def _foxglove_pose(message: Any) -> Iterator[TransformMessage]:
    pose = _pose(message.pose.position, message.pose.orientation)
    yield TransformMessage(_time_ns(message.timestamp), message.frame_id, "", *pose)


def _pose(position: Any, quaternion: Any) -> tuple[Floats, Floats]:
    q = (quaternion.x, quaternion.y, quaternion.z, quaternion.w)
    return np.array([position.x, position.y, position.z]), np.array(q)


IMAGES: Mapping[str, Callable[[Any], ImageMessage]] = {
    "sensor_msgs/Image": _ros_image,
    "sensor_msgs/CompressedImage": _ros_compressed,
    "foxglove.RawImage": _foxglove_image,
    "foxglove.CompressedImage": _foxglove_compressed,
}
CALIBRATIONS: Mapping[str, Callable[[Any], CalibrationMessage]] = {
    "sensor_msgs/CameraInfo": _ros_calibration,
    "foxglove.CameraCalibration": _foxglove_calibration,
}
TRANSFORMS: dict[str, Callable[[Any], Iterator[TransformMessage]]] = {
    "tf2_msgs/TFMessage": _ros_transforms,
    "tf/tfMessage": _ros_transforms,
    "foxglove.FrameTransform": _foxglove_transform,
    "foxglove.FrameTransforms": _foxglove_transforms,
}
POSES: dict[str, Callable[[Any], Iterator[TransformMessage]]] = {
    "nav_msgs/Odometry": lambda fields: iter([_ros_transform(fields)]),
    "geometry_msgs/TransformStamped": lambda fields: iter([_ros_transform(fields)]),
    "geometry_msgs/PoseStamped": _ros_pose,
    "geometry_msgs/PoseWithCovarianceStamped": _ros_pose,
    "foxglove.PoseInFrame": _foxglove_pose,
}
