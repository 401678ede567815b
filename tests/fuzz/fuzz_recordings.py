"""Bags, logs and sequences: strangers' files that hold images, calibrations and poses."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from fuzz_formats import Format, pictures, sound_images, sound_poses

from omnilab.api import RecordedPoses
from omnilab_recordings import ImageSequence, RosBag
from omnilab_recordings.on_bad_image import OnBadImage
from omnilab_recordings.streams.sensor import StreamSensor

COUNT, STEP_NS, BEGIN_NS = 6, 10**8, 1_700_000_000_000_000_000
UNIT = "0 0 0 1"


def played(sensor: StreamSensor) -> None:
    """Play a recording back as a study does."""
    plan = sensor.plan(RecordedPoses())
    if plan.T_world_camera is not None:
        sound_poses(plan.T_world_camera)
    for frames in sensor.frames(plan):
        sound_images(frames.images, *frames.images.shape[3:])


def bag(name: str) -> Callable[[Path], None]:
    """Writer of a bag: .bag of ROS 1, or .db3 or .mcap of ROS 2."""

    def write(folder: Path) -> None:
        from rosbags.rosbag1 import Writer as Writer1
        from rosbags.rosbag2 import StoragePlugin
        from rosbags.rosbag2 import Writer as Writer2
        from rosbags.typesys import Stores, get_typestore

        is_ros1 = name.endswith(".bag")
        store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
        plugin = StoragePlugin.MCAP if name.endswith(".mcap") else StoragePlugin.SQLITE3
        writer: Any = Writer1(folder / name) if is_ros1 else Writer2(folder / "bag", version=8, storage_plugin=plugin)
        with writer:
            connections: dict[str, Any] = {}
            for topic, at, message in messages(store.types, is_ros1):
                kind = message.__msgtype__
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=store)
                data = store.serialize_ros1(message, kind) if is_ros1 else store.serialize_cdr(message, kind)
                writer.write(connections[topic], at, data)
        if not is_ros1:
            next((folder / "bag").glob(f"*{Path(name).suffix}")).rename(folder / name)
            shutil.rmtree(folder / "bag")

    return write


def messages(types: Any, is_ros1: bool) -> list[tuple[str, int, Any]]:
    """A calibration, images raw and compressed, and poses."""

    def of(kind: str, **fields: Any) -> Any:
        return types[kind.replace("/", "/msg/")](**fields)

    def header(at: int) -> Any:
        stamp = of("builtin_interfaces/Time", sec=at // 10**9, nanosec=at % 10**9)
        return of("std_msgs/Header", stamp=stamp, frame_id="cam", **({"seq": 1} if is_ros1 else {}))

    names = {
        "d": np.zeros(5),
        "k": np.array([20.0, 0, 16, 0, 20, 16, 0, 0, 1]),
        "r": np.eye(3).ravel(),
        "p": np.eye(3, 4).ravel(),
    }
    region = of("sensor_msgs/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    found = [("/cam/camera_info", BEGIN_NS, of(
        "sensor_msgs/CameraInfo", header=header(BEGIN_NS), height=32, width=32, distortion_model="plumb_bob", binning_x=0,
        binning_y=0, roi=region, **{name.upper() if is_ros1 else name: value for name, value in names.items()},
    ))]  # fmt: skip
    rng = np.random.default_rng(0)
    for i in range(COUNT):
        at = BEGIN_NS + i * STEP_NS
        pixels = rng.integers(0, 255, (32, 32), np.uint8)
        image = {"height": 32, "width": 32, "encoding": "mono8", "is_bigendian": 0, "step": 32, "data": pixels.ravel()}
        packed = np.frombuffer(cv2.imencode(".png", pixels)[1].tobytes(), np.uint8)
        found += [
            ("/cam/image_raw", at, of("sensor_msgs/Image", header=header(at), **image)),
            ("/cam/compressed", at, of("sensor_msgs/CompressedImage", header=header(at), format="png", data=packed)),
            ("/pose", at, of("geometry_msgs/PoseStamped", header=header(at), pose=of(
                "geometry_msgs/Pose", position=of("geometry_msgs/Point", x=float(i), y=0.0, z=0.0),
                orientation=of("geometry_msgs/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
            ))),
        ]  # fmt: skip
    return found


def bag_format(name: str, topic: str) -> Format:
    def read(folder: Path) -> None:
        played(RosBag(str(folder / name), topic=topic, poses="/pose", on_bad_image=OnBadImage.skip))

    return Format(name, bag(name), read)


def tum(folder: Path) -> None:
    pictures(folder)
    (folder / "rgb.txt").write_text("# times and files\n" + "".join(f"{i}.5 {i}.png\n" for i in range(3)))
    (folder / "groundtruth.txt").write_text("".join(f"{i}.5 {i} 0 1 {UNIT}\n" for i in range(3)))


def euroc(folder: Path) -> None:
    camera, truth = folder / "mav0/cam0", folder / "mav0/state_groundtruth_estimate0"
    (camera / "data").mkdir(parents=True)
    truth.mkdir()
    pictures(camera / "data")
    (camera / "data.csv").write_text(
        "#timestamp [ns],filename\n" + "".join(f"{i * STEP_NS},{i}.png\n" for i in range(3))
    )
    (camera / "sensor.yaml").write_text(
        f"T_BS:\n  cols: 4\n  rows: 4\n  data: {np.eye(4).ravel().tolist()}\nresolution: [32, 32]\ncamera_model: pinhole\n"
        "intrinsics: [20.0, 20.0, 16.0, 16.0]\ndistortion_model: radial-tangential\ndistortion_coefficients: [0, 0, 0, 0]\n"
    )
    (truth / "data.csv").write_text("#timestamp\n" + "".join(f"{i * STEP_NS},{i},0,1,1,0,0,0\n" for i in range(3)))


def kitti360(folder: Path) -> None:
    (folder / "image_02/data_rgb").mkdir(parents=True)
    pictures(folder / "image_02/data_rgb")
    (folder / "image_02/timestamps.txt").write_text("".join(f"2013-05-28 08:46:0{i}.903769088\n" for i in range(3)))
    matrix = " ".join(map(str, np.eye(4)[:3].ravel()))
    (folder / "poses.txt").write_text("".join(f"{i} {matrix}\n" for i in range(3)))
    (folder / "calib_cam_to_pose.txt").write_text(f"image_02: {matrix}\n")


def sequence(folder: Path, **settings: Any) -> None:
    played(ImageSequence(str(folder), on_bad_image=OnBadImage.skip, **settings))


def in_circle(folder: Path) -> None:
    sequence(folder, circle_px=[16.0, 16.0, 15.0])


RECORDINGS: dict[str, Format] = {
    "bag_ros1": bag_format("drive.bag", "/cam/image_raw"),
    "bag_ros2_sqlite": bag_format("drive.db3", "/cam/image_raw"),
    "bag_ros2_mcap": bag_format("drive.mcap", "/cam/image_raw"),
    "bag_compressed": bag_format("drive.bag", "/cam/compressed"),
    "sequence_tum_listing": Format("rgb.txt", tum, in_circle),
    "sequence_tum_truth": Format("groundtruth.txt", tum, in_circle),
    "sequence_euroc_listing": Format("mav0/cam0/data.csv", euroc, sequence),
    "sequence_euroc_camera": Format("mav0/cam0/sensor.yaml", euroc, sequence),
    "sequence_euroc_truth": Format("mav0/state_groundtruth_estimate0/data.csv", euroc, sequence),
    "sequence_kitti360_times": Format("image_02/timestamps.txt", kitti360, in_circle),
    "sequence_kitti360_poses": Format("poses.txt", kitti360, in_circle),
    "sequence_kitti360_camera": Format("calib_cam_to_pose.txt", kitti360, in_circle),
}
