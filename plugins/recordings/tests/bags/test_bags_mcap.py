"""MCAP logs: those of omnilab's own runs, Foxglove's messages, real ones of ROS 2, damaged ones."""

from __future__ import annotations

import contextlib
import io
import json
from dataclasses import asdict
from pathlib import Path

import cv2
import numpy as np
import pytest
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import register_schema

from omnilab import api
from omnilab.api import RecordedPoses
from omnilab.cameras import PinholeCamera, UnifiedCamera
from omnilab.errors import DataError
from omnilab.geometry import rotation_xyz
from omnilab.image import encode
from omnilab_mcap import McapSink
from omnilab_recordings import Mcap

BEGIN_NS = 1_700_000_000_000_000_000
TENTH = 10**8
SPHERE = {"panorama": "equirectangular"}
REAL = Path(__file__).parents[4] / "../shared/data/mcap"


def taken(sensor: Mcap) -> np.ndarray:
    return np.concatenate([frames.images for frames in sensor.frames(sensor.plan(RecordedPoses()))])


def time_of(i: int) -> Timestamp:
    return Timestamp(seconds=BEGIN_NS // 10**9, nanos=BEGIN_NS % 10**9 + i * TENTH)


def written(
    path: Path, messages: list, packed: CompressionType = CompressionType.ZSTD, attached: dict | None = None
) -> Path:
    """A log by the reference library: topics, record times and messages of protobuf."""
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=4000, compression=packed)
        writer.start()
        for name, data in (attached or {}).items():
            writer.add_attachment(0, 0, name, "application/json", data)
        channels: dict[str, int] = {}
        for topic, record_ns, message in messages:
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "protobuf", register_schema(writer, type(message)))
            writer.add_message(channels[topic], record_ns, message.SerializeToString(), record_ns)
        writer.finish()
    return path


def raw(pixels: np.ndarray, i: int, encoding: str = "mono8") -> RawImage:
    rows = pixels.reshape(len(pixels), -1)
    return RawImage(
        timestamp=time_of(i), frame_id="cam", height=len(pixels), width=pixels.shape[1], encoding=encoding,
        step=rows.shape[1], data=rows.tobytes(),
    )  # fmt: skip


def test_a_log_of_a_run_is_played_back_as_it_was_logged(tmp_path: Path) -> None:
    """Pixels as the JPEG that it holds decodes, those of PNG as they were, times and poses with them."""
    rng = np.random.default_rng(1)
    pictures = np.stack([cv2.blur(p, (3, 3)) for p in rng.integers(0, 255, (6, 20, 64, 3), np.uint8)])
    T = np.tile(np.eye(4), (6, 1, 1))
    T[:, :3, :3], T[:, :3, 3] = rotation_xyz(rng.normal(size=6), 0.1, rng.normal(size=6)), rng.normal(size=(6, 3))
    sink = McapSink()
    sink.open(tmp_path)
    for i, picture in enumerate(pictures):
        tick = api.Tick(i, BEGIN_NS + i * TENTH)
        sink.write("camera/jpeg", api.Image(picture), tick)
        sink.write("camera/png", api.Image(picture, "png"), tick)
        sink.write("camera", api.Pose(T[i]), tick)
    sink.close()
    log = str(tmp_path / "run.mcap")
    assert np.array_equal(taken(Mcap(log, topic="/camera/png", color=True, **SPHERE)), pictures)
    jpeg = [cv2.imdecode(np.frombuffer(encode(p, "jpeg"), np.uint8), cv2.IMREAD_COLOR_RGB) for p in pictures]
    assert np.array_equal(taken(Mcap(log, topic="/camera/jpeg", color=True, **SPHERE)), jpeg)
    sensor = Mcap(log, topic="/camera/png", **SPHERE)
    plan = sensor.plan(RecordedPoses())
    assert plan.T_world_camera == pytest.approx(T, abs=1e-12)
    assert sensor.stream.stamps_ns.tolist() == [BEGIN_NS + i * TENTH for i in range(6)]


def test_raw_and_compressed_images_of_foxglove(tmp_path: Path, pictures: np.ndarray) -> None:
    for packed in CompressionType:
        log = written(
            tmp_path / f"{packed.name}.mcap",
            [("/raw", BEGIN_NS + i, raw(p, i)) for i, p in enumerate(pictures)],
            packed,
        )
        assert np.array_equal(taken(Mcap(str(log), **SPHERE)), pictures)
    png = [
        CompressedImage(timestamp=time_of(i), frame_id="cam", format="png", data=cv2.imencode(".png", p)[1].tobytes())
        for i, p in enumerate(pictures)
    ]
    log = written(tmp_path / "png.mcap", [("/png", BEGIN_NS + i, message) for i, message in enumerate(png)])
    assert np.array_equal(taken(Mcap(str(log), **SPHERE)), pictures)


def test_the_camera_of_a_calibration_or_of_an_attachment(tmp_path: Path, pictures: np.ndarray) -> None:
    info = CameraCalibration(
        timestamp=time_of(0),
        frame_id="cam",
        width=64,
        height=20,
        distortion_model="plumb_bob",
        D=[0.0] * 5,
        K=[40, 0, 32, 0, 41, 10, 0, 0, 1],
    )
    log = written(tmp_path / "a.mcap", [("/calibration", BEGIN_NS, info), ("/raw", BEGIN_NS, raw(pictures[0], 0))])
    assert Mcap(str(log)).optics.camera.fy == 41
    camera = UnifiedCamera(width=64, height=20, fx=30.1, fy=30.2, cx=31.7, cy=9.3, xi=0.9, looks="down")
    text = json.dumps({"model": "UnifiedCamera", **asdict(camera)}).encode()
    log = written(tmp_path / "b.mcap", [("/raw", BEGIN_NS, raw(pictures[0], 0))], attached={"camera.json": text})
    assert Mcap(str(log)).optics.camera == camera
    assert not isinstance(Mcap(str(log)).optics.camera, PinholeCamera)
    log = written(tmp_path / "c.mcap", [("/raw", BEGIN_NS, raw(pictures[0], 0))], attached={"camera.json": b"[1, 2"})
    with pytest.raises(DataError, match=r"has an attachment camera.json that is none; give sensor.camera=FILE"):
        taken(Mcap(str(log)))


@pytest.mark.skipif(not REAL.is_dir(), reason="the samples of rosbag2 are not here")
@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("talker", r"/topic \(std_msgs/String, 10\)"),
        ("wbag_0", r"AAA \(std_msgs/String, 174\), BBB \(std_msgs/String, 145\)"),
        ("cdr_test_0", r"/array_topic \(test_msgs/Arrays, 4\)"),
        ("topics_and_services", r"/add_two_ints/_service_event \(example_interfaces/srv/AddTwoInts_Event, 6\)"),
    ],
)
def test_real_logs_without_images_say_what_they_hold(name: str, said: str) -> None:
    with pytest.raises(DataError, match=rf"has no images .*{said}"):
        Mcap(str(REAL / f"rosbag2_{name}.mcap")).plan(RecordedPoses())


# -------------------------------------------------------------------------------------------------------------- damage
def test_a_log_that_was_cut_off_is_read_up_to_there(tmp_path: Path, pictures: np.ndarray) -> None:
    log = written(tmp_path / "whole.mcap", [("/raw", BEGIN_NS + i, raw(p, i)) for i, p in enumerate(pictures)])
    data = log.read_bytes()
    counts = []
    for end in range(len(data), 0, -397):
        (tmp_path / "cut.mcap").write_bytes(data[:end])
        images = pictures[:0]
        with contextlib.suppress(DataError):  # before the first chunk is whole
            images = taken(Mcap(str(tmp_path / "cut.mcap"), **SPHERE))
        assert np.array_equal(images, pictures[: len(images)])
        counts.append(len(images))
    assert counts == sorted(counts, reverse=True)
    assert set(counts) == {8, 6, 3, 0}  # chunk by chunk


def test_a_damaged_chunk_costs_its_own_images(tmp_path: Path, pictures: np.ndarray) -> None:
    log = written(
        tmp_path / "log.mcap", [("/raw", BEGIN_NS + i, raw(p, i)) for i, p in enumerate(pictures)], CompressionType.NONE
    )
    data = bytearray(log.read_bytes())
    at = data.index(pictures[4].tobytes()[:100])
    data[at + 50] ^= 255
    log.write_bytes(data)
    sensor = Mcap(str(log), **SPHERE)
    images = taken(sensor)
    assert 4 <= len(images) < 8
    assert all(any(np.array_equal(image, p) for p in pictures) for image in images)
    assert "a chunk that fails its checksum" in sensor.stream.remarks["damage"]


@pytest.mark.parametrize("packed", ["zstd", "lz4"])
def test_what_would_not_fit_into_memory_is_not_unpacked(tmp_path: Path, pictures: np.ndarray, packed: str) -> None:
    """A chunk that says it is small, and of 200 MB of zeros."""
    import lz4.frame
    import zstandard

    zeros = bytes(200 * 2**20)
    bomb = zstandard.compress(zeros) if packed == "zstd" else lz4.frame.compress(zeros)
    log = written(tmp_path / "log.mcap", [("/raw", BEGIN_NS, raw(pictures[0], 0))])
    data = log.read_bytes()
    record = io.BytesIO()
    name = packed.encode()
    content = bytes(16) + (1000).to_bytes(8, "little") + bytes(4) + len(name).to_bytes(4, "little") + name
    content += len(bomb).to_bytes(8, "little") + bomb
    record.write(bytes([6]) + len(content).to_bytes(8, "little") + content)
    begin = 8 + 9 + int.from_bytes(data[9:17], "little")
    log.write_bytes(data[:begin] + record.getvalue() + data[begin:])
    sensor = Mcap(str(log), **SPHERE)
    assert len(taken(sensor)) == 1
    assert "unpacks to another size than it says" in sensor.stream.remarks["damage"]
