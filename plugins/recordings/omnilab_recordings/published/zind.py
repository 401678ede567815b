"""Tours of the Zillow Indoor Dataset (Cruz et al., CVPR 2021): where each panorama of a home was taken, and in which room."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from omnilab.errors import DataError
from omnilab.file_kinds import content_of

LARGEST_TOUR = 2**28  # bytes
FRONT_DEG = 90.0  # of a picture's middle, from +x of the plan, where the rotation is 0
SCALE = "scale_meters_per_coordinate"


@dataclass(frozen=True)
class TourPanorama:
    """One panorama of a home, in a right-handed world with z up from its floor."""

    file: str  # below the tour's folder
    room: str  # complete_room_06: all that no door divides
    x_m: float
    y_m: float
    z_m: float
    yaw_deg: float  # of the picture's middle, counter-clockwise from +x


def tour_of(file: Path) -> dict[str, list[TourPanorama]]:
    """The panoramas of each floor of a zind_data.json; none of a floor without a scale. DataError for another file.

    As the set's own code has it (code/transformations.py), a point of a panorama's plan is turned by `rotation`, multiplied by
    `scale` and moved by `translation`, and its azimuths run clockwise from the middle of the picture, which looks along +y: so
    the plan is the world seen from below, and y is negated here. Heights of cameras are 1 in their own plans.
    """
    tour = _read(file)
    scales = _mapping(file, tour, SCALE)
    floors = {}
    for floor, rooms in _mapping(file, tour, "merger").items():
        metres = scales.get(floor)
        found = [] if metres is None else list(_floor(file, floor, rooms, _number(file, metres, f"{SCALE} of {floor}")))
        floors[_name(file, floor)] = found
    return floors


def _floor(file: Path, floor: str, rooms: Any, metres: float) -> Iterator[TourPanorama]:
    for room, parts in _items(file, rooms, floor):
        for part, panoramas in _items(file, parts, room):
            for name, known in _items(file, panoramas, part):
                yield _panorama(file, _name(file, room), f"{part}, {name}", known, metres)


def _panorama(file: Path, room: str, of: str, known: Any, metres: float) -> TourPanorama:
    image = known.get("image_path") if isinstance(known, dict) else None
    if not isinstance(image, str) or PurePosixPath(image).is_absolute() or ".." in PurePosixPath(image).parts:
        raise DataError(f"{file} names no image below its folder for {of} (image_path); is it the set's own file?")
    plan = _mapping(file, known, "floor_plan_transformation", of)
    at = plan.get("translation")
    if not isinstance(at, list) or len(at) != 2:
        raise DataError(f"{file} has no translation of two numbers for {of}; is it the set's own file?")
    x, y = (metres * _number(file, value, f"the translation of {of}") for value in at)
    height, scale, rotation = (
        _number(file, where.get(key), f"{key} of {of}")
        for where, key in ((known, "camera_height"), (plan, "scale"), (plan, "rotation"))
    )
    yaw_deg = (-FRONT_DEG - rotation + 180) % 360 - 180
    return TourPanorama(image, room, x, -y, metres * scale * height, yaw_deg)


def _read(file: Path) -> dict[str, Any]:
    try:
        tour = json.loads(content_of(file, LARGEST_TOUR))
    except (ValueError, RecursionError) as error:
        raise DataError(f"{file} is no JSON ({' '.join(str(error).split())}); give the set's own file") from error
    if not isinstance(tour, dict):
        raise DataError(f"{file} is no tour of ZInD, which is a JSON object; give the set's own zind_data.json")
    return tour


def _mapping(file: Path, whole: Mapping[str, Any], key: str, of: str = "the tour") -> dict[str, Any]:
    if not isinstance(found := whole.get(key), dict):
        raise DataError(f"{file} has no {key} for {of}; is it the zind_data.json of a tour?")
    return found


def _items(file: Path, found: Any, of: str) -> Iterator[tuple[str, Any]]:
    if not isinstance(found, dict):
        raise DataError(f"{file} holds no rooms and panoramas in {of}; is it the zind_data.json of a tour?")
    yield from found.items()


def _name(file: Path, name: str) -> str:
    """A floor or room that becomes a folder."""
    if not re.fullmatch(r"\w{1,100}", name):
        raise DataError(
            f"{file} has {name[:40]!r} where floor_01 or complete_room_01 is due; is it the set's own file?"
        )
    return name


def _number(file: Path, value: Any, what: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise DataError(f"{file} has {value!r:.40} where {what} is due; is it the set's own file?")
    return float(value)
