"""Folders laid out as TUM's, EuRoC's and KITTI-360's sets are, their poses composed by scipy's rotations."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from omnilab.api import RecordedPoses
from omnilab.cameras import BrownConradyCamera, KannalaBrandtCamera, UnifiedCamera
from omnilab.errors import DataError
from omnilab.testing import check_sensor
from omnilab_recordings import ImageSequence

BEGIN_NS = 1_403_636_579_763_555_584
STEP_NS = 50_000_000
COUNT = 6
PICTURES = np.random.default_rng(0).integers(0, 255, (COUNT, 24, 32), np.uint8)
TIMES = BEGIN_NS + STEP_NS * np.arange(COUNT)


def rigid(R: Rotation, t: np.ndarray) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R.as_matrix(), t
    return T


RNG = np.random.default_rng(1)
BODY = [rigid(Rotation.from_rotvec(RNG.normal(size=3)), RNG.normal(size=3)) for _ in range(COUNT)]
MOUNT = rigid(Rotation.from_rotvec([0.3, -1.2, 0.4]), np.array([0.1, 0.2, 0.3]))


def in_our_axes(T: np.ndarray, looks: str) -> np.ndarray:
    """Of an optical frame: where it looks ahead, x is ahead and z is up; where it looks down, z is behind it."""
    right, down, ahead = T[:3, 0], T[:3, 1], T[:3, 2]
    axes = {"ahead": (ahead, -right, -down), "down": (right, -down, -ahead)}[looks]
    turned = T.copy()
    turned[:3, :3] = np.stack(axes, 1)
    return turned


def write_images(folder: Path, names: list[str]) -> None:
    folder.mkdir(parents=True)
    for name, picture in zip(names, PICTURES, strict=True):
        assert cv2.imwrite(str(folder / name), picture)


def numbers(T: np.ndarray) -> str:
    return " ".join(map(repr, T[:3].ravel().tolist()))


def check(sensor: ImageSequence, optical: list[np.ndarray], looks: str = "ahead") -> None:
    check_sensor(sensor, RecordedPoses())
    plan = sensor.plan(RecordedPoses())
    (frames,) = sensor.frames(plan)
    assert np.array_equal(frames.images, PICTURES)
    assert plan.T_world_camera == pytest.approx(np.stack([in_our_axes(T, looks) for T in optical]), abs=1e-9)
    assert frames.stamps_ns.tolist() == TIMES.tolist()


def seconds(ns: int) -> str:
    return f"{ns // 10**9}.{ns % 10**9:09d}"


@pytest.fixture
def tum(tmp_path: Path) -> Path:
    names = [f"{seconds(int(t))}.png" for t in TIMES]
    write_images(tmp_path / "rgb", names)
    lines = [f"{seconds(int(t))} rgb/{name}" for t, name in zip(TIMES, names, strict=True)]
    (tmp_path / "rgb.txt").write_text("# color images\n# timestamp filename\n" + "\n".join(lines) + "\n")
    poses = [
        " ".join(
            [
                seconds(int(t)),
                *map(repr, T[:3, 3].tolist()),
                *map(repr, Rotation.from_matrix(T[:3, :3]).as_quat().tolist()),
            ]
        )
        for t, T in zip(TIMES, BODY, strict=True)
    ]
    (tmp_path / "groundtruth.txt").write_text("# timestamp tx ty tz qx qy qz qw\n" + "\n".join(poses) + "\n")
    return tmp_path


@pytest.fixture
def euroc(tmp_path: Path) -> Path:
    camera, truth = tmp_path / "mav0/cam0", tmp_path / "mav0/state_groundtruth_estimate0"
    write_images(camera / "data", [f"{t}.png" for t in TIMES])
    (camera / "data.csv").write_text("#timestamp [ns],filename\r\n" + "".join(f"{t},{t}.png\r\n" for t in TIMES))
    (camera / "sensor.yaml").write_text(
        "%YAML:1.0\n---\nsensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n  data: "
        f"{MOUNT.ravel().tolist()}\nrate_hz: 20\nresolution: [32, 24]\ncamera_model: pinhole\nintrinsics: [20.5, 20.4, 15.6, 11.7]\n"
        "distortion_model: radial-tangential\ndistortion_coefficients: [-0.28, 0.07, 0.0002, 1.7e-05]\n"
    )
    truth.mkdir()
    rows = []
    for t, T in zip(TIMES, BODY, strict=True):
        x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat().tolist()
        rows.append(",".join([str(t), *map(repr, [*T[:3, 3].tolist(), w, x, y, z]), *["0"] * 9]))
    (truth / "data.csv").write_text("#timestamp, p_RS_R_x [m], ...\n" + "\n".join(rows) + "\n")
    return tmp_path


@pytest.fixture
def kitti(tmp_path: Path) -> Path:
    drive = tmp_path / "data_2d_raw/2013_05_28_drive_0000_sync"
    write_images(drive / "image_02/data_rgb", [f"{i:010d}.png" for i in range(COUNT)])
    dates = [f"{datetime.fromtimestamp(int(t) // 10**9, UTC):%Y-%m-%d %H:%M:%S}.{int(t) % 10**9:09d}" for t in TIMES]
    (drive / "image_02/timestamps.txt").write_text("\n".join(dates) + "\n")
    poses = tmp_path / "data_poses" / drive.name
    poses.mkdir(parents=True)
    (poses / "poses.txt").write_text("".join(f"{i} {numbers(T)} \n" for i, T in enumerate(BODY)))
    (tmp_path / "calibration").mkdir()
    other = numbers(np.eye(4))
    (tmp_path / "calibration/calib_cam_to_pose.txt").write_text(f"image_00: {other}\nimage_02: {numbers(MOUNT)}\n")
    (tmp_path / "calibration/image_02.yaml").write_text(
        "%YAML:1.0\n---\nmodel_type: MEI\ncamera_name: image_02\nimage_width: 32\nimage_height: 24\nmirror_parameters:\n   xi: 2.2\n"
        "distortion_parameters:\n   k1: 0.01\n   k2: 0.02\n   p1: 0.0\n   p2: 0.0\n"
        "projection_parameters:\n   gamma1: 30.0\n   gamma2: 30.1\n   u0: 15.5\n   v0: 11.5\n"
    )
    return drive


def test_tum(tum: Path) -> None:
    check(ImageSequence(str(tum), circle_px=[16, 12, 10]), BODY)
    check(ImageSequence(str(tum), circle_px=[16, 12, 10], looks="down"), BODY, "down")


def test_euroc(euroc: Path) -> None:
    sensor = ImageSequence(str(euroc))
    check(sensor, [T @ MOUNT for T in BODY])
    camera = sensor.optics.camera
    assert isinstance(camera, BrownConradyCamera)
    assert (camera.fx, camera.k1, camera.looks) == (20.5, -0.28, "ahead")
    assert "T_BS of sensor.yaml leads to the camera" in sensor.stream.remarks["poses of"]
    check(ImageSequence(str(euroc / "mav0")), [T @ MOUNT for T in BODY])


def test_tum_vi_is_euroc_with_a_fisheye_and_motion_capture(euroc: Path) -> None:
    (euroc / "mav0/state_groundtruth_estimate0").rename(euroc / "mav0/mocap0")
    file = euroc / "mav0/cam0/sensor.yaml"
    file.write_text(file.read_text().replace("radial-tangential", "equidistant"))
    sensor = ImageSequence(str(euroc))
    check(sensor, [T @ MOUNT for T in BODY])
    assert isinstance(sensor.optics.camera, KannalaBrandtCamera)


def test_kitti_360(kitti: Path) -> None:
    sensor = ImageSequence(str(kitti))
    check(sensor, [T @ MOUNT for T in BODY])
    assert isinstance(sensor.optics.camera, UnifiedCamera)
    (kitti.parents[1] / "calibration/calib_cam_to_pose.txt").unlink()
    sensor = ImageSequence(str(kitti))
    assert sensor.plan(RecordedPoses()).T_world_camera is None
    assert "poses.txt or calib_cam_to_pose.txt is not beside" in sensor.stream.remarks["poses"]


def test_folders_that_are_not_whole(tum: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    with pytest.raises(DataError, match=r"has none of the layouts that are read: TUM \(rgb.txt.*EuRoC.*KITTI-360"):
        ImageSequence(str(tmp_path_factory.mktemp("empty"))).plan(RecordedPoses())
    (tum / "rgb" / f"{seconds(int(TIMES[2]))}.png").unlink()
    with pytest.raises(DataError, match=r"#2: .*png cannot be read \(No such file or directory\).*on_bad_image=skip"):
        list(ImageSequence(str(tum), circle_px=[16, 12, 10]).frames(ImageSequence(str(tum)).plan(RecordedPoses())))
    (tum / "rgb.txt").write_text("1.5 ../../secret.png\n")
    with pytest.raises(DataError, match=r"names '../../secret.png', which is no image below"):
        ImageSequence(str(tum)).plan(RecordedPoses())
    (tum / "rgb.txt").write_text("1.5\n")
    with pytest.raises(DataError, match=r"line 1 of .*rgb.txt"):
        ImageSequence(str(tum)).plan(RecordedPoses())
    (tum / "rgb.txt").write_text("soon rgb/1.png\n")
    with pytest.raises(DataError, match="soon"):
        ImageSequence(str(tum)).plan(RecordedPoses())
