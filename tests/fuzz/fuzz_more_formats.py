"""Calibrations of other tools, rendered data sets, and what lies within containers."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from fuzz_containers import in_glb, in_npz, in_png
from fuzz_formats import FORMATS, Format, pictures, recording, sound_camera, text_file

from omnilab.cameras import PinholeCamera, load_camera, save_camera
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


def deep_picture(kind: Callable[[np.ndarray], np.ndarray], suffix: str) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        ramp = np.add.outer(np.arange(32), np.arange(32)) / 64
        for i in range(2):
            cv2.imwrite(str(folder / f"{i}.{suffix}"), kind(ramp))

    return write


def picture(kind: Callable[[np.ndarray], np.ndarray], suffix: str = "png") -> Format:
    return Format(f"1.{suffix}", deep_picture(kind, suffix), lambda folder: recording(folder, positions=None))


MORE: dict[str, Format] = {
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
    "picture_16_bit": picture(lambda ramp: (ramp * 65535).astype(np.uint16)),
    "picture_alpha": picture(lambda ramp: np.dstack([np.tile(ramp[..., None] * 255, 3), 255 - ramp * 100]).astype(np.uint8)),
    "within_map": replace(FORMATS["map_npz"], mutate=in_npz),
    "within_basis": replace(FORMATS["basis_npz"], mutate=in_npz),
    "within_png": replace(FORMATS["image_png"], mutate=in_png),
    "within_glb": replace(FORMATS["mesh_glb"], mutate=in_glb),
}  # fmt: skip
ALL = FORMATS | MORE
