"""Nearest-neighbour localisation: method 1 of the thesis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from omnilab.api import Distance, Estimates, Places, Signatures
from omnilab.errors import DataError
from omnilab.geometry import heading_of, wrap_angle


@dataclass
class Nearest:
    """The position of the place with the smallest distance, and its heading plus the rotation (thesis, 4.5.1)."""

    def prepare(self, places: Places, distance: Distance) -> tuple[Places, Distance, Any]:
        """The map, the distance, and what the distance keeps of the map."""
        check_map(places, "nearest")
        return places, distance, distance.prepare(places.signatures)

    def locate(self, queries: Signatures, index: tuple[Places, Distance, Any]) -> Estimates:
        """Compare with every place, answer the nearest."""
        places, distance, prepared = index
        assert places.T_world_camera is not None
        match = distance.match(queries, prepared)
        best = match.distance.argmin(axis=1)
        every = np.arange(len(best))
        poses = places.T_world_camera[best]
        heading = None
        if match.rotation_rad is not None:
            heading = wrap_angle(heading_of(poses) + match.rotation_rad[every, best])
        return Estimates(best, match.distance[every, best], poses[:, :3, 3], heading, match.distance)


def check_map(places: Places, localizer: str) -> None:
    """DataError unless there are places, and positions of them."""
    if len(places) == 0:
        raise DataError("the map has no places, so nothing can be localised; give a layout with places")
    if places.T_world_camera is None:
        raise DataError(f"the places have no positions; localizer={localizer} needs a map with positions")
