"""A localizer: the mean of the places that look most alike."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from omnilab import (
    DataError,
    Distance,
    Estimates,
    Floats,
    Localizer,
    Places,
    Signatures,
    check_settings,
    setting,
)
from omnilab.geometry import heading_of, wrap_angle


class PreparedMap(NamedTuple):
    """A map that queries can be located in."""

    T_world_camera: Floats  # (P, 4, 4)
    distance: Distance
    index: Any  # what the distance keeps of the places


@dataclass
class MyLocalizer:
    """The mean position of the most alike places, weighted by one over their distance.

    The heading is that of the most alike one and the rotation from it, where the distance
    estimates rotations.
    """

    neighbours: int = setting(3, at_least=1, at_most=1000)  # places in the mean

    def __post_init__(self) -> None:
        check_settings(self)

    def prepare(self, places: Places, distance: Distance) -> PreparedMap:
        """The map made ready; `locate` takes it as `index`."""
        if len(places) == 0 or places.T_world_camera is None:
            raise DataError(
                "the map has no places with positions, so nothing can be localised; give"
                " the study a sensor that knows its poses"
            )
        index = distance.prepare(places.signatures)
        return PreparedMap(places.T_world_camera, distance, index)

    def locate(self, queries: Signatures, index: PreparedMap) -> Estimates:
        """Where each of Q queries was taken."""
        match = index.distance.match(queries, index.index)
        ranked = np.argsort(match.distance, axis=1, kind="stable")
        nearest = ranked[:, : self.neighbours]
        distances = np.take_along_axis(match.distance, nearest, axis=1)
        weights = 1 / np.maximum(distances, 1e-9)
        weights /= weights.sum(axis=1, keepdims=True)
        positions_m = index.T_world_camera[nearest, :3, 3]  # (Q, neighbours, 3)
        position_m = (weights[..., None] * positions_m).sum(axis=1)
        best, heading_rad = nearest[:, 0], None
        if match.rotation_rad is not None:
            rotation_rad = match.rotation_rad[np.arange(len(best)), best]
            heading_rad = wrap_angle(
                heading_of(index.T_world_camera[best]) + rotation_rad
            )
        return Estimates(best, distances[:, 0], position_m, heading_rad, match.distance)


# a type checker compares it with the contract:
_: type[Localizer] = MyLocalizer
