"""Calibrations of other tools, rendered data sets, and what lies within containers."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import av
import cv2
import numpy as np
from fuzz_containers import in_glb, in_npz, in_png
from fuzz_engine import confirm
from fuzz_formats import FORMATS, Format, pictures, recording, sound_camera, sound_images, text_file
from fuzz_recordings import RECORDINGS

from omnilab.api import RecordedPoses
from omnilab.cameras import PinholeCamera, load_camera, save_camera
from omnilab.runner.fidelity.kept import read_kept, write_kept
from omnilab.runner.fidelity.measured import MeasuredRun, MeasuredValue, RunSettings
from omnilab_recordings import Video
from omnilab_studies.common.dataset_files import DataSet

KALIBR = """cam0:
  T_cam_imu:
  - [0.0, 1.0, 0.0, 0.07]
  - [-1.0, 0.0, 0.0, -0.01]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: MODEL
  distortion_coeffs: [-0.0017, 0.0244, -0.0358, 0.0199]
  distortion_model: DISTORTION
  intrinsics: [INTRINSICS461.5, 460.1, 362.4, 246.2]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
"""
CAMERA_INFO = """image_width: 752
image_height: 480
camera_name: narrow
camera_matrix: {rows: 3, cols: 3, data: [461.5, 0, 362.4, 0, 460.1, 246.2, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.28, 0.07, 2e-4, 1.8e-5, 1e-2]}
rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
projection_matrix: {rows: 3, cols: 4, data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]}
"""
MEI = """%YAML:1.0
---
model_type: MEI
camera_name: image_02
image_width: 752
image_height: 480
mirror_parameters: {xi: 1.47}
distortion_parameters: {k1: -2.1e-01, k2: 0.6, p1: -1e-3, p2: 7e-4}
projection_parameters: {gamma1: 461.5, gamma2: 460.1, u0: 362.4, v0: 246.2}
"""
PYOCAMCALIB = json.dumps({
    "taylor_coefficient": [-120.0, 0.0, 1.1e-3, -2e-6, 1e-8], "stretch_matrix": [[1.0, 0.0], [0.0, 1.0]],
    "distortion_center": [121.0, 120.0], "image_size": [242, 240],
})  # fmt: skip


def kalibr(model: str, distortion: str, more: str = "") -> str:
    return KALIBR.replace("MODEL", model).replace("DISTORTION", distortion).replace("INTRINSICS", more)


def calibration(name: str, text: str) -> Format:
    return Format(name, text_file(name, text), lambda folder: sound_camera(load_camera(folder / name)))


def of_opencv(folder: Path) -> None:
    file = cv2.FileStorage(str(folder / "camera.yml"), cv2.FILE_STORAGE_WRITE)
    file.write("image_width", 752)
    file.write("image_height", 480)
    file.write("camera_matrix", np.array([[461.5, 0, 362.4], [0, 460.1, 246.2], [0, 0, 1.0]]))
    file.write("distortion_coefficients", np.array([[-0.28, 0.07, 2e-4, 1.8e-5, 0.01]]))
    file.release()


def data_set(folder: Path) -> None:
    """A folder as `omnilab experiment=render` leaves it."""
    (folder / "images").mkdir()
    pictures(folder / "images")
    save_camera(
        PinholeCamera(width=32, height=32, cx=15.5, cy=15.5, looks="ahead", focal_px=20.0), folder / "camera.json"
    )
    (folder / "positions.csv").write_text(
        "image,x_m,y_m,z_m,yaw_deg\n" + "".join(f"images/{i}.png,{i},0,1,{i}\n" for i in range(3))
    )


def begun(folder: Path) -> None:
    """A data set that is begun, or gone on with."""
    contents = {
        "sensor": {"size": 32, "world": "room"},
        "disturbances": {},
        "plan": "a1b2",
        "seed": 7,
        "frames": 3,
    }
    DataSet(folder).open(contents)


def measurements(folder: Path) -> None:
    """What `omnilab fidelity report --keep` leaves."""
    made = RunSettings({"study": "pose_graph"}, {"study.wrong_loops": "0.1"})
    values = {"ate": MeasuredValue(0.1, 0.05, 0.2, "m"), "lost_rate": MeasuredValue(math.nan)}
    run = MeasuredRun("0", made, "pose_graph/a", "0.1.0", "abcdef0", "2026-01-02T03:04:05+00:00", 61.5, values)
    write_kept(folder / "kept.json", {"graph": [run, replace(run, seed="1")]})


def kept_measurements(folder: Path) -> None:
    """Read them, and what a table shows of them."""
    for run in (run for runs in read_kept(folder / "kept.json").values() for run in runs):
        texts = [run.seed, run.folder, run.version, run.commit, run.ended, *(v.unit for v in run.values.values())]
        confirm(not any(set(text) & set("`|<>\n") for text in texts), "a text that a table cannot hold")
        numbers = [number for v in run.values.values() for number in (v.value, v.low, v.high) if number is not None]
        confirm(not any(map(math.isinf, numbers)), "a number is not finite")


def deep_picture(kind: Callable[[np.ndarray], np.ndarray], suffix: str) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        ramp = np.add.outer(np.arange(32), np.arange(32)) / 64
        for i in range(2):
            cv2.imwrite(str(folder / f"{i}.{suffix}"), kind(ramp))

    return write


def picture(kind: Callable[[np.ndarray], np.ndarray], suffix: str = "png") -> Format:
    return Format(f"1.{suffix}", deep_picture(kind, suffix), lambda folder: recording(folder, positions=None))


def film(codec: str, pix_fmt: str, suffix: str) -> Format:
    def write(folder: Path) -> None:
        with av.open(str(folder / f"a.{suffix}"), "w") as container:
            stream = container.add_stream(codec, rate=20)
            stream.width, stream.height, stream.pix_fmt = 32, 32, pix_fmt
            for i in range(6):
                grey = np.add.outer(np.arange(32), 4 * np.arange(32) + 8 * i).astype(np.uint8)
                container.mux(stream.encode(av.VideoFrame.from_ndarray(grey, format="gray").reformat(format=pix_fmt)))
            container.mux(stream.encode())

    def read(folder: Path) -> None:
        sensor = Video(str(folder / f"a.{suffix}"), circle_px=[16.0, 16.0, 15.0])
        for frames in sensor.frames(sensor.plan(RecordedPoses())):
            sound_images(frames.images)

    return Format(f"a.{suffix}", write, read)


MORE: dict[str, Format] = {
    "video_mkv": film("mpeg4", "yuv420p", "mkv"),
    "video_avi": film("mjpeg", "yuvj420p", "avi"),
    "video_mp4": film("mpeg4", "yuv420p", "mp4"),
    "calibration_kalibr_equi": calibration("c.yaml", kalibr("pinhole", "equidistant")),
    "calibration_kalibr_radtan": calibration("c.yaml", kalibr("pinhole", "radtan")),
    "calibration_kalibr_omni": calibration("c.yaml", kalibr("omni", "radtan", "1.47, ")),
    "calibration_camera_info": calibration("c.yaml", CAMERA_INFO),
    "calibration_mei": calibration("c.yaml", MEI),
    "calibration_pyocamcalib": calibration("c.json", PYOCAMCALIB),
    "calibration_opencv": Format("camera.yml", of_opencv, lambda folder: sound_camera(load_camera(folder / "camera.yml"))),
    "dataset_positions": Format("positions.csv", data_set, lambda folder: recording(folder, circle_px=None)),
    "dataset_camera": Format("camera.json", data_set, lambda folder: recording(folder, circle_px=None)),
    "dataset_about": Format("dataset.json", begun, begun),
    "kept_measurements": Format("kept.json", measurements, kept_measurements),
    "picture_16_bit": picture(lambda ramp: (ramp * 65535).astype(np.uint16)),
    "picture_alpha": picture(lambda ramp: np.dstack([np.tile(ramp[..., None] * 255, 3), 255 - ramp * 100]).astype(np.uint8)),
    "within_map": replace(FORMATS["map_npz"], mutate=in_npz),
    "within_basis": replace(FORMATS["basis_npz"], mutate=in_npz),
    "within_png": replace(FORMATS["image_png"], mutate=in_png),
    "within_glb": replace(FORMATS["mesh_glb"], mutate=in_glb),
}  # fmt: skip
ALL = FORMATS | MORE | RECORDINGS
