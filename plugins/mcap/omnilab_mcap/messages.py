"""From records to protobuf messages, Foxglove's wherever it has one."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from functools import singledispatch

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.Pose_pb2 import Pose as PoseMessage
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.message import Message  # type: ignore[import-untyped]
from google.protobuf.timestamp_pb2 import Timestamp  # type: ignore[import-untyped]

from omnilab import api
from omnilab.api import Bytes, Floats, Ints, Tick
from omnilab.geometry import planar_poses, quaternion_xyzw
from omnilab.image import encode
from omnilab_mcap import schema
from omnilab_mcap.vectors import add_vectors

WORLD, CAMERA = "world", "camera"
LEVELS = {"INFO": Log.Level.INFO, "NOTE": Log.Level.INFO, "WARN": Log.Level.WARNING, "ERROR": Log.Level.ERROR}
VERDICT_COLORS = {
    "nearest": Color(r=0.2, g=0.7, b=0.3, a=1.0),
    "second": Color(r=0.95, g=0.7, b=0.1, a=1.0),
    "wrong": Color(r=0.9, g=0.2, b=0.2, a=1.0),
}
GREY = Color(r=0.45, g=0.5, b=0.6, a=1.0)
IDENTITY = PoseMessage(position=Vector3(), orientation=Quaternion(w=1.0))
Topics = Iterable[tuple[str, Message]]


@singledispatch
def messages(record: api.Record, topic: str, tick: Tick) -> Topics:  # noqa: ARG001
    """The messages of one record, each with its topic. Progress and layouts concern screens and have none."""
    return ()


@messages.register
def image(record: api.Image, topic: str, tick: Tick) -> Topics:
    data = record.encoded or encode(record.pixels, record.format)
    yield topic, CompressedImage(timestamp=stamp(tick), frame_id=CAMERA, data=data, format=record.format)


@messages.register
def signature(record: api.Signature, topic: str, tick: Tick) -> Topics:
    rows, columns = record.values.shape
    picture = RawImage(timestamp=stamp(tick), frame_id=CAMERA, height=rows, width=columns, encoding="32FC1")
    picture.step = 4 * columns
    picture.data = record.values.astype("<f4").tobytes()
    yield topic, picture


@messages.register
def place_map(record: api.PlaceMap, topic: str, tick: Tick) -> Topics:
    if record.heading_rad is None:
        yield topic, cloud(record.position_m, {}, tick)
    else:
        T_world_place = planar_poses(record.position_m, record.heading_rad)
        yield topic, PosesInFrame(timestamp=stamp(tick), frame_id=WORLD, poses=poses(T_world_place))


@messages.register
def distance_field(record: api.DistanceField, topic: str, tick: Tick) -> Topics:
    yield topic, cloud(record.position_m, {"distance": record.values}, tick)


@messages.register
def pose(record: api.Pose, topic: str, tick: Tick) -> Topics:
    (at,) = poses(record.T_world_camera[None])
    yield topic, PoseInFrame(timestamp=stamp(tick), frame_id=WORLD, pose=at)
    # Rerun expects a picture of the frame X in X_image_plane, and shows nothing in 3-D while that hangs in the air
    carrier = topic.split("/")[1]
    plane = transform(carrier, f"{carrier}_image_plane", IDENTITY, tick)
    yield "/tf", FrameTransforms(transforms=[transform(WORLD, carrier, at, tick), plane])


@messages.register
def estimate(record: api.Estimate, topic: str, tick: Tick) -> Topics:
    message = schema.Estimate(timestamp=stamp(tick), step=tick.step, verdict=record.verdict)
    message.truth_m.x, message.truth_m.y, message.truth_m.z = record.truth_m.tolist()
    message.answer_m.x, message.answer_m.y, message.answer_m.z = record.answer_m.tolist()
    message.truth_heading_rad = record.truth_heading_rad
    message.answer_heading_rad = math.nan if record.answer_heading_rad is None else record.answer_heading_rad
    yield topic, message
    alone = api.Answers(record.truth_m[None], record.answer_m[None], [record.verdict])
    yield from answers(alone, f"{topic}/line", tick)


@messages.register
def answers(record: api.Answers, topic: str, tick: Tick) -> Topics:
    verdicts = np.array(record.verdict)
    ends = np.stack([record.truth_m, record.answer_m], axis=1)
    entities = [lines(verdict, ends[verdicts == verdict], tick) for verdict in sorted(set(record.verdict))]
    yield topic, scene(entities, tick)


@messages.register
def mesh(record: api.Mesh, topic: str, tick: Tick) -> Topics:
    surface = TriangleListPrimitive(pose=IDENTITY, indices=record.triangles.ravel().tolist())
    add_vectors(surface, "points", record.vertices_m)
    add_vectors(surface, "colors", opaque(record.colors))
    yield topic, scene([SceneEntity(timestamp=stamp(tick), frame_id=WORLD, id=topic, triangles=[surface])], tick)


@messages.register
def point_cloud(record: api.PointCloud, topic: str, tick: Tick) -> Topics:
    channels = (*record.colors.T, np.full(len(record.colors), 255))
    yield topic, cloud(record.points_m, {}, tick, dict(zip(("red", "green", "blue", "alpha"), channels, strict=True)))


@messages.register
def graph(record: api.Graph, topic: str, tick: Tick) -> Topics:
    yield f"{topic}/points", cloud(record.position_m, {}, tick)
    ends = record.position_m[record.edges].reshape(-1, 3)
    edges = LinePrimitive(type=LinePrimitive.LINE_LIST, pose=IDENTITY, thickness=2.0, scale_invariant=True, color=GREY)
    add_vectors(edges, "points", ends)
    if record.colors is not None:
        add_vectors(edges, "colors", opaque(record.colors.repeat(2, axis=0)))
    yield topic, scene([SceneEntity(timestamp=stamp(tick), frame_id=WORLD, id=topic, lines=[edges])], tick)


@messages.register
def text(record: api.Text, topic: str, tick: Tick) -> Topics:
    yield topic, Log(timestamp=stamp(tick), level=LEVELS[record.level], message=record.text, name=topic)


def scalars(record: api.Series) -> Iterator[tuple[Message, Tick]]:
    """The rows of a curve, each with its own tick."""
    rows = zip(record.values.tolist(), record.steps.tolist(), record.stamps_ns.tolist(), strict=True)
    for value, step, stamp_ns in rows:
        tick = Tick(step, stamp_ns)
        yield schema.Scalar(timestamp=stamp(tick), step=step, value=value, unit=record.unit), tick


def stamp(tick: Tick) -> Timestamp:
    """The sensor's time."""
    seconds, nanos = divmod(tick.stamp_ns, 10**9)
    return Timestamp(seconds=seconds, nanos=nanos)


def transform(parent: str, child: str, pose: PoseMessage, tick: Tick) -> FrameTransform:
    """Where a frame is in its parent."""
    return FrameTransform(
        timestamp=stamp(tick),
        parent_frame_id=parent,
        child_frame_id=child,
        translation=pose.position,
        rotation=pose.orientation,
    )


def opaque(colors: Bytes) -> Floats:
    """Colours (N, 4) from 0 to 1, of RGB (N, 3)."""
    return np.column_stack([colors / 255, np.ones(len(colors))])


def poses(T: Floats) -> list[PoseMessage]:
    """Poses (N, 4, 4)."""
    positions, quaternions = T[:, :3, 3].tolist(), quaternion_xyzw(T).tolist()
    return [
        PoseMessage(position=Vector3(x=px, y=py, z=pz), orientation=Quaternion(x=x, y=y, z=z, w=w))
        for (px, py, pz), (x, y, z, w) in zip(positions, quaternions, strict=True)
    ]


def cloud(
    position_m: Floats, values: dict[str, Floats], tick: Tick, colors: dict[str, Ints] | None = None
) -> PointCloud:
    """Points (N, 3) and what holds at each (N,), as float32 in the frame "world"; colours are bytes."""
    columns = dict(zip("xyz", position_m.T, strict=True)) | values
    layout = [(name, "<f4") for name in columns] + [(name, "u1") for name in colors or {}]
    packed = np.empty(len(position_m), np.dtype(layout))
    for name, column in (columns | (colors or {})).items():
        packed[name] = column
    number = {"<f4": PackedElementField.FLOAT32, "u1": PackedElementField.UINT8}
    starts = np.cumsum([0, *(int(kind[-1]) for _, kind in layout)])
    fields = [
        PackedElementField(name=name, offset=start, type=number[kind])
        for (name, kind), start in zip(layout, starts[:-1].tolist(), strict=True)
    ]
    return PointCloud(
        timestamp=stamp(tick),
        frame_id=WORLD,
        pose=IDENTITY,
        point_stride=packed.itemsize,
        fields=fields,
        data=packed.tobytes(),
    )


def lines(verdict: str, ends_m: Floats, tick: Tick) -> SceneEntity:
    """Lines (N, 2, 3) from truths to the answers of one verdict, three pixels wide."""
    line = LinePrimitive(type=LinePrimitive.LINE_LIST, pose=IDENTITY, thickness=3.0, scale_invariant=True)
    add_vectors(line, "points", ends_m.reshape(-1, 3))
    line.color.CopyFrom(VERDICT_COLORS[verdict])
    return SceneEntity(timestamp=stamp(tick), frame_id=WORLD, id=verdict, lines=[line])


def scene(entities: list[SceneEntity], tick: Tick) -> SceneUpdate:
    """These entities in place of all that the topic showed before."""
    earlier = SceneEntityDeletion(timestamp=stamp(tick), type=SceneEntityDeletion.ALL)
    return SceneUpdate(deletions=[earlier], entities=entities)
