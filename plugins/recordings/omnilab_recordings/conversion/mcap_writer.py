"""A data set on disk as an MCAP log: its PNG images as they are, their poses as transforms, the camera as an attachment."""

from __future__ import annotations

from pathlib import Path
from typing import Any, BinaryIO

from omnilab.api import RecordedPoses
from omnilab.atomic_files import write_whole
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import quaternion_xyzw
from omnilab.limits import check_work
from omnilab_recordings.bags.bag_stream import CAMERA_FILE
from omnilab_recordings.folder import Folder
from omnilab_recordings.images.files import read_bytes

IMAGES, FRAMES = "/camera/image", "/tf"
WORLD, CAMERA = "world", "camera"  # frames


def check_new(file: Path) -> None:
    """ConfigError if a file is there, or could not be written."""
    if file.exists():
        raise ConfigError(f"{file} is there already; give a new file, --mcap FILE")
    if not file.absolute().parent.is_dir():
        raise ConfigError(f"{file} is in no folder that exists; give --mcap FILE elsewhere")


def write_mcap(folder: Path, file: Path) -> None:
    """Write a log of the data set in a folder; the file is whole or not there."""
    sensor = Folder(str(folder))
    plan, stamps_ns = sensor.plan(RecordedPoses()), sensor.recording.stamps_ns(sensor.recording.images)
    size = sum((folder / name).stat().st_size for name in plan.keys)
    check_work(f"{len(plan)} images", "give a file with more room", disk=size, folder=file.absolute().parent)

    def write(out: BinaryIO) -> None:
        from mcap.writer import Writer

        writer = Writer(out)
        writer.start()
        if (camera := folder / CAMERA_FILE).is_file():
            writer.add_attachment(0, 0, CAMERA_FILE, "application/json", read_bytes(folder, camera.name))
        _write_messages(writer, folder, list(plan.keys), stamps_ns.tolist(), plan.T_world_camera)
        writer.finish()

    try:
        write_whole(file, write)
    except OSError as error:
        raise DataError(f"{file} cannot be written ({error.strerror}); make room, or give another place") from error


def _write_messages(writer: Any, folder: Path, names: list[str], stamps_ns: list[int], T: Any) -> None:
    from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
    from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
    from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
    from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
    from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
    from google.protobuf.timestamp_pb2 import Timestamp  # type: ignore[import-untyped]
    from mcap_protobuf.schema import register_schema

    def channel(topic: str, kind: type[Any]) -> int:
        number: int = writer.register_channel(topic, "protobuf", register_schema(writer, kind))
        return number

    images, frames = channel(IMAGES, CompressedImage), channel(FRAMES, FrameTransforms)
    for i, (name, stamp_ns) in enumerate(zip(names, stamps_ns, strict=True)):
        time = Timestamp(seconds=stamp_ns // 10**9, nanos=stamp_ns % 10**9)
        data = read_bytes(folder, name)
        image = CompressedImage(timestamp=time, frame_id=CAMERA, data=data, format=Path(name).suffix.removeprefix("."))
        writer.add_message(images, stamp_ns, image.SerializeToString(), stamp_ns, i)
        if T is None:
            continue
        (x, y, z), (qx, qy, qz, qw) = T[i, :3, 3].tolist(), quaternion_xyzw(T[i]).tolist()
        pose = FrameTransform(
            timestamp=time, parent_frame_id=WORLD, child_frame_id=CAMERA,
            translation=Vector3(x=x, y=y, z=z), rotation=Quaternion(x=qx, y=qy, z=qz, w=qw),
        )  # fmt: skip
        writer.add_message(frames, stamp_ns, FrameTransforms(transforms=[pose]).SerializeToString(), stamp_ns, i)
