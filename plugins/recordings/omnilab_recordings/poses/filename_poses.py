"""Poses from the names of image files: by a pattern with named groups, or by the naming of a published set."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import Decimal, InvalidOperation
from typing import Any

import numpy as np

from omnilab.api import Floats, Ints
from omnilab.errors import ConfigError, DataError, did_you_mean
from omnilab.geometry import rotation_xyz
from omnilab.trajectory.clocks import unit_of
from omnilab.trajectory.columns import HEADINGS, LENGTHS, STAMPS
from omnilab.trajectory.lookalikes import remedy_for
from omnilab_recordings.panoramas import Panorama
from omnilab_recordings.poses.positions import Positions

LONGEST_PATTERN = 300  # characters; Python's re can take for ever where repetitions nest, so keep patterns plain
LONGEST_PATH = 1024  # characters
SHOWN = 3  # names in a message
INDICES = ("ix", "iy", "i", "iz")
GROUPS = (*INDICES, *LENGTHS, *HEADINGS, *STAMPS, "view")
AXES = {axis: [name for name, (of, _) in LENGTHS.items() if of == axis] for axis in "xyz"}
NEEDED_BY = {"spacing_m": ("ix", "iy", "i"), "columns": ("i",), "height_step_m": ("iz",), "lowest_m": ("iz",)}


@dataclass(frozen=True)
class Naming:
    """Naming scheme of images by their poses. The pattern is searched for in the path below the folder; its groups are among `GROUPS`.

    `ix`, `iy` are column and row, `i` counts images row by row, `iz` counts levels; `i` and `iz` start at the lowest
    number there is. `view` tells images of one pose apart and is not used otherwise.
    """

    pattern: str
    spacing_m: float | None = None  # between columns and between rows
    columns: int | None = None  # in a row, for `i`
    lowest_m: float | None = None  # height of the lowest level
    height_step_m: float | None = None  # between levels
    panorama: Panorama | None = None  # what the set's pictures are as published, where they are that wide


FLOAT = r"-?\d+\.?\d*"
TWO_NUMBERS = r"(?P<ix>\d+)[^\d/]+(?P<iy>\d+)[^\d/]*$"
ONE_NUMBER = r"(?P<i>\d+)[^\d/]*$"
PRESETS = {  # README of the plugin: which of them were read off a source, and which are assumed
    "bielefeld": Naming(TWO_NUMBERS, spacing_m=0.3),
    "moeller": Naming(TWO_NUMBERS, panorama=Panorama.strip),
    "umh_altitude": Naming(
        r"(?P<ix>\d+)\D+(?P<iz>\d+)[^\d/]*$", spacing_m=1.0, lowest_m=1.25, height_step_m=0.15
    ),
    "umh_grid": Naming(ONE_NUMBER, spacing_m=0.2, columns=8),
    "quorum_v": Naming(TWO_NUMBERS, spacing_m=0.4, panorama=Panorama.strip),
    "cold": Naming(rf"t(?P<stamp_s>\d+\.\d+)_x(?P<x_m>{FLOAT})_y(?P<y_m>{FLOAT})_a(?P<yaw_rad>{FLOAT})\.jpe?g$"),
    "utm": Naming(
        r"@(?P<x_m>[^@/]+)@(?P<y_m>[^@/]+)@"
        r"(?:(?:[^@/]*@){4}(?P<view>[^@/]*@[^@/]*)@(?P<heading_deg>[^@/]*)@)?[^/]*$"
    ),
}  # fmt: skip


def naming(names: str, **given: float | None) -> Naming:
    """The preset of that name or the pattern itself, with the settings that are given; ConfigError if it cannot be."""
    if names not in PRESETS and re.fullmatch(r"\w*", names):
        raise ConfigError(
            f"names={names!r} is no preset{did_you_mean(names, PRESETS)}; there is {', '.join(PRESETS)},"
            " or a regular expression with named groups such as (?P<ix>\\d+)_(?P<iy>\\d+)"
        )
    chosen = PRESETS.get(names) or Naming(names)
    groups = _groups(chosen.pattern)
    for setting, users in NEEDED_BY.items():
        if given.get(setting) is not None and not groups & set(users):
            raise ConfigError(
                f"{setting}={given[setting]} is of no use: names={names!r} has no {' or '.join(users)}; leave it out"
            )
    chosen = replace(chosen, **{key: value for key, value in given.items() if value is not None})  # type: ignore[arg-type]
    for setting, users in NEEDED_BY.items():
        used = groups & set(users)
        if used and setting != "lowest_m" and not (getattr(chosen, setting) or 0) > 0:
            raise ConfigError(
                f"names={names!r} has the group {min(used)}, so {setting}={getattr(chosen, setting)} cannot be;"
                f" give sensor.{setting} above 0"
            )
    return chosen


def _groups(pattern: str) -> set[str]:
    if len(pattern) > LONGEST_PATTERN:
        raise ConfigError(f"names has {len(pattern)} characters; give a pattern of at most {LONGEST_PATTERN}")
    try:
        groups = set(re.compile(pattern).groupindex)
    except re.error as error:
        raise ConfigError(f"names={pattern!r} is no regular expression ({error}); mend it") from error
    for group in sorted(groups - set(GROUPS)):
        hint = f" ({found})" if (found := remedy_for(group)) else did_you_mean(group, GROUPS)
        raise ConfigError(f"names has the group '{group}'{hint}; it may be {', '.join(GROUPS)}")
    if not groups & {*INDICES, *LENGTHS}:
        raise ConfigError(
            f"names={pattern!r} gives no position; name a group, (?P<ix>\\d+) say, one of {', '.join(GROUPS)}"
        )
    return groups


def positions_of(images: Sequence[str], how: Naming) -> Positions:
    """Where N images were taken, by their names; DataError with the first names that do not say it."""
    texts = _texts(images, how.pattern)
    for quantity, units in {"heading": HEADINGS, "time": STAMPS, **AXES}.items():
        if len(twice := [unit for unit in units if unit in texts]) > 1:
            raise ConfigError(f"sensor.names gives the {quantity} twice, as {' and '.join(twice)}; leave one out")
    values = {
        group: _numbers(images, group, texts[group]) for group in texts if group in {*INDICES, *LENGTHS, *HEADINGS}
    }
    if "i" in values:
        values["iy"], values["ix"] = np.divmod(values["i"] - values["i"].min(), how.columns or 1)
    yaw_rad = sum((radians(values[yaw]) for yaw, radians in HEADINGS.items() if yaw in values), np.zeros(len(images)))
    found = Positions(
        images=list(images),
        position_m=np.stack([_along_m(axis, values, how, len(images)) for axis in "xyz"], -1),
        R_world_robot=rotation_xyz(0, 0, yaw_rad),
        cells=np.stack([values["ix"], values["iy"]], -1).astype(np.int64) if {"ix", "iy"} <= set(values) else None,
        stamps_ns=_stamps_ns(images, texts),
        turn=tuple(name for name in HEADINGS if name in values),
        numbers=next((values[name] for name in HEADINGS if name in values), None),
    )
    _check_different(found, yaw_rad, texts.get("view", [""] * len(images)))
    return found


def _texts(images: Sequence[str], pattern: str) -> dict[str, list[str]]:
    """What each group matches in each name; groups that are empty in all names are left out."""
    found = [re.search(pattern, image) if len(image) <= LONGEST_PATH else None for image in images]
    _check_all(images, [match is not None for match in found], f"match names={pattern!r}")
    texts = {group: [(match and match[group]) or "" for match in found] for group in re.compile(pattern).groupindex}
    for group, column in texts.items():
        if any(column) and group != "view":
            _check_all(images, [text != "" for text in column], f"have a value for {group}")
    return {group: column for group, column in texts.items() if any(column)}


def _check_all(images: Sequence[str], good: Sequence[bool], what: str) -> None:
    bad = [image for image, is_good in zip(images, good, strict=True) if not is_good]
    if bad:
        raise DataError(
            f"{len(bad)} of {len(images)} image names do not {what} ({', '.join(bad[:SHOWN])}{', ...' * (len(bad) > SHOWN)});"
            " mend sensor.names, or narrow sensor.pattern to the images it is for"
        )


def _numbers(images: Sequence[str], group: str, texts: Sequence[str]) -> Floats:
    return np.array([float(_number(image, group, text)) for image, text in zip(images, texts, strict=True)])


def _number(image: str, group: str, text: str, times: int = 1) -> Decimal:
    try:
        value = Decimal(text) * times
    except InvalidOperation:
        value = Decimal("nan")
    if not (value.is_finite() and abs(value) < 2**63):
        unit = unit_of(float(text)) if group == "stamp_s" and value.is_finite() else None
        remedy = f"is too large for seconds and looks like {unit}" if unit else "is no number"
        raise DataError(f"{image} has {group}={text!r}, which {remedy}; mend sensor.names or the file's name")
    return value


def _along_m(axis: str, values: dict[str, Floats], how: Naming, count: int) -> Floats:
    """Coordinates (N,) along an axis: measured, or counted."""
    for group, (of, metres) in LENGTHS.items():
        if group in values and axis == of:
            return values[group] * metres
    if axis == "z" and "iz" in values:
        return np.asarray((how.lowest_m or 0.0) + (how.height_step_m or 0.0) * (values["iz"] - values["iz"].min()))
    return (how.spacing_m or 0.0) * values.get(f"i{axis}", np.zeros(count)) if axis != "z" else np.zeros(count)


def _stamps_ns(images: Sequence[str], texts: dict[str, list[str]]) -> Ints | None:
    for group, ns in STAMPS.items():
        if group in texts:
            stamps = [int(_number(image, group, text, ns)) for image, text in zip(images, texts[group], strict=True)]
            return np.array(stamps, np.int64)
    return None


def _check_different(found: Positions, yaw_rad: Floats, views: Sequence[str]) -> None:
    """DataError if two images without stamps have one pose."""
    if found.stamps_ns is not None:
        return
    first: dict[tuple[Any, ...], str] = {}
    for image, where, yaw, view in zip(found.images, found.position_m, yaw_rad, views, strict=True):
        other = first.setdefault((*where, yaw, view), image)
        if other != image:
            raise DataError(
                f"{other} and {image} have one pose by their names; add a group (?P<view>...) of what tells them apart,"
                " or narrow sensor.pattern to one series"
            )
