"""Draws the pictures of docs/cameras.md and docs/worlds.md: uv run python docs/pictures.py"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from omnilab import geometry
from omnilab.api import Bytes, PathPoses
from omnilab.cameras import UnifiedCamera, save_camera
from omnilab.image import panorama
from omnilab.runner.registry import discover
from omnilab_mirror.sensors.virtual import VirtualCamera

DOCS = Path(__file__).parent
HERE = [-1.2, -0.6, 1.1, 105.0]  # x, y, z and heading in degrees: where all cameras stand
LONG = {"camera": 500, "world": 900}  # pixels of a picture's longer side
WORLDS = {
    "room": HERE,
    "office": [0.0, 0.0, 1.1, 0.0],
    "corridor": [-2.0, 0.0, 1.1, 0.0],
    "square": [-3.0, -3.0, 1.4, 30.0],
    "storey": [0.0, -18.4, 1.1, 0.0],
    "plain": HERE,
}
OCAM = """#polynomial coefficients for the DIRECT mapping function (ocam_model.ss in MATLAB)

5 -1.0e+02 0.0 2.0e-03 1.0e-06 1.0e-08

#center: "row" and "column", starting from 0 (C convention)

199.5 199.5

#affine parameters "c", "d", "e"

1.0 0.0 0.0

#image size: "height" and "width"

400 400
"""


def picture(sensor: VirtualCamera, at: list[float]) -> Bytes:
    """What a sensor sees."""
    x, y, z, heading = at
    T = geometry.planar_poses([x, y, z], np.deg2rad(heading))
    (frames,) = sensor.frames(sensor.plan(PathPoses(T)))
    return frames.images[0]


def save(kind: str, name: str, image: Bytes) -> None:
    """A JPEG in docs/pictures."""
    scale = LONG[kind] / max(image.shape[:2])
    if scale < 1:
        image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    (DOCS / "pictures").mkdir(exist_ok=True)
    bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    cv2.imwrite(str(DOCS / "pictures" / f"{kind}_{name}.jpg"), bgr, [cv2.IMWRITE_JPEG_QUALITY, 82])


def cameras() -> None:
    """The same room through every camera."""
    with TemporaryDirectory() as folder:
        calibration, camera = Path(folder) / "calib_results.txt", Path(folder) / "camera.json"
        calibration.write_text(OCAM, encoding="utf-8")
        save_camera(UnifiedCamera(width=400, height=400, cx=199.5, cy=199.5, fx=120, fy=120, xi=0.9), camera)
        special = {
            "ocam": {"file": str(calibration)},
            "calibrated": {"file": str(camera)},
            "mirror": {"size": 500, "crop": 1.0},
        }
        registry = discover("")
        for name in registry.names("sensor"):
            cls = registry.get("sensor", name).cls
            if issubclass(cls, VirtualCamera):
                save("camera", name, picture(cls(color=True, samples=16, **special.get(name, {})), HERE))


def worlds() -> None:
    """Every shipped world, through the mirror, unwrapped."""
    from omnilab_mirror import Mirror

    for world, at in WORLDS.items():
        sensor = Mirror(world=world, color=True, samples=9, size=900, crop=1.0)
        wide = panorama(picture(sensor, at)[None], sensor.camera, (256, 1024))[0]
        save("world", world, wide[:, ::-1])


if __name__ == "__main__":
    cameras()
    worlds()
