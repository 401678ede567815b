"""The frame of calibration tools and of ROS's optical frames (x right, y down, z ahead), and that of `omnilab.api`."""

from __future__ import annotations

import numpy as np

from omnilab.api import Floats
from omnilab.cameras.lenses import AXES


def optical_to_camera(looks: str) -> Floats:
    """T_optical_camera (4, 4): takes points of omnilab's camera frame to the optical frame of a camera that looks so."""
    T = np.eye(4)
    T[:3, :3] = AXES[looks].T
    if looks == "up":  # pictures of such a camera are flipped left to right
        T[0] *= -1
    return T
