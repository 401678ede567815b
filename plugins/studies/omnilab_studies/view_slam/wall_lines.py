"""The walls of a world as lines of a floor plan."""

from __future__ import annotations

import numpy as np

from omnilab.api import Floats, Mesh

OFF_PLANE_M = 1e-6  # added to the height: the plane then passes beside the corners of what is built in round numbers


def wall_lines(mesh: Mesh | None, height_m: float) -> Floats:
    """Where the triangles of a world's surface cross the horizontal plane at a height: lines (W, 2, 2) in x and y, metres."""
    if mesh is None or len(mesh.triangles) == 0:
        return np.zeros((0, 2, 2))
    corners = np.asarray(mesh.vertices_m, float)[mesh.triangles]
    above = corners[:, :, 2] - (height_m + OFF_PLANE_M)
    crossing = (above.min(axis=1) < 0) & (above.max(axis=1) > 0)
    corners, above = corners[crossing], above[crossing]
    number = np.arange(len(corners))
    alone = np.argmax(np.sign(above) == -np.sign(np.median(above, axis=1))[:, None], axis=1)
    ends = []
    for step in (1, 2):  # from the corner that is alone on its side to both others
        other = (alone + step) % 3
        share = above[number, alone] / (above[number, alone] - above[number, other])
        ends.append(corners[number, alone] + share[:, None] * (corners[number, other] - corners[number, alone]))
    return np.stack(ends, axis=1)[:, :, :2]
