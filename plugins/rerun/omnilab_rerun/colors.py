"""Colours of truth, places, verdicts and distances."""

from __future__ import annotations

import numpy as np

from omnilab.api import Bytes, Floats

Color = tuple[int, int, int]

TRUTH: Color = (255, 255, 255)
PLACE: Color = (110, 130, 160)
VERDICT: dict[str, Color] = {"nearest": (70, 200, 120), "second": (245, 180, 60), "wrong": (235, 80, 80)}
RUNS: dict[str, Color] = {  # of runs that are shown together; by Okabe and Ito, to be told apart by every eye
    "blue": (86, 180, 233),
    "orange": (230, 159, 0),
    "green": (0, 188, 135),
    "pink": (224, 130, 190),
    "yellow": (240, 228, 66),
    "red": (225, 87, 20),
    "violet": (150, 120, 255),
    "grey": (170, 170, 170),
}


def heat(share: Floats) -> Bytes:
    """RGB colours (P, 3), from dark (0) to bright (1)."""
    import cv2

    levels = np.clip(255 * share, 0, 255).astype(np.uint8)[:, None]
    return np.asarray(cv2.applyColorMap(levels, cv2.COLORMAP_VIRIDIS)[:, 0, ::-1], np.uint8)
