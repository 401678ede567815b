"""Poses that can be read but that no robot can have had: units, orders, axes and times that were taken for others.

A question is one sentence: what was found, and what to do if the other reading is right. It changes no pose. What may as
well be as it is written is left alone.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from omnilab.api import Floats, Ints
from omnilab.geometry import heading_of, quaternion_xyzw, rotation_of_quaternion
from omnilab.trajectory.columns import MATRIX, QUATERNION
from omnilab.trajectory.files import Trajectory

log = logging.getLogger("omnilab")

LEAST = 8  # poses, or stretches of a path, that anything is concluded from
AGREE, APART = 0.9, 0.5  # mean resultant lengths: what another reading needs, and what the given one stays below
ALIKE = 0.7  # mean resultant length above which directions are too much alike to tell anything
STRETCHES = 64  # of a path, whose directions are compared with the headings
UPRIGHT, TIPPED = 0.98, 0.5  # cosines of the tilt of a robot on a floor, and of one that has tipped over
FASTEST_M_S = 100.0  # no robot that takes pictures is faster
SLIP_M, SLIP_EXTENTS = 5.0, 3.0  # how far slips lie from all other positions, also in extents of these
SLIPS, MOST_SLIPS = 0.15, 20  # largest share of slips, and number
FAR_APART_M, FAR_APART_WHOLE_M = 50.0, 20.0  # places of pictures, also where all are whole numbers
GEOREFERENCED_M = 50_000.0  # coordinates of a country's map are beyond
GLOBE_M, GLOBE_STEP_M = 0.5, 2e-4  # within 0.5 degrees, every 20 m: no robot moves by so little
GLOBE_LEAST_M = 0.02  # what two kilometres are in degrees, whatever the steps are
SHORTEST_NS = 500_000  # between two images, or poses of wheels
AGAINST = "headings turn against the path"
SWAPPED = "x and y are swapped, or one of them is of the other sign: mend these columns"
TENTH_S = 100_000_000  # between images whose times nobody knows


def warn(of: str, path: Trajectory) -> None:
    """Log the questions about a file of poses, `of`, that is read for a run."""
    for question in [*about_positions(path), *about_headings(path, "change their signs")]:
        log.warning("%s: %s", of, question)


def about_positions(path: Trajectory) -> Iterator[str]:
    """Questions about positions, times and the order of quaternions; none for most files."""
    position, stamps = path.T_world_camera[:, :3, 3], path.stamps_ns
    found = [
        about_globe(position) or about_size(position, stamps),
        about_slips(position),
        about_times(stamps),
        about_quaternions(path.T_world_camera, path.turn) or about_camera_axes(path),
    ]
    yield from (question for question in found if question)


def about_headings(path: Trajectory, clockwise: str) -> Iterator[str]:
    """Questions about headings against directions of travel. `clockwise`: what to do if they run clockwise."""
    found = about_units(path) or about_turns(path, clockwise)
    yield from [found] if found else []


def about_axes(path: Trajectory) -> Iterator[str]:
    """The same where it is known that the headings are right: then an axis is not."""
    if about_turns(path, ""):
        yield f"{AGAINST}, so {SWAPPED}"


# ------------------------------------------------------------------------------------------------- positions and times
def about_globe(position: Floats) -> str | None:
    """Degrees of longitude and latitude (N, 3) as metres."""
    xy = position[:, :2]
    low, high = xy.min(axis=0), xy.max(axis=0)
    most = np.maximum(np.abs(low), np.abs(high))
    extent = (high - low).max()
    if not len(xy) or extent > GLOBE_M or np.abs(xy).min() < 1 or most.min() > 90 or most.max() > 180:
        return None
    if len(np.unique(xy, axis=0)) < LEAST:
        return None
    if extent > GLOBE_LEAST_M and np.quantile(_nearest(position), 0.9) > GLOBE_STEP_M:
        return None
    return (
        f"all positions lie within {extent * 1000:.2g} mm of x, y = {low[0]:.5f}, {low[1]:.5f}; if these are"
        " degrees of longitude and latitude, project them (to UTM, say) to metres"
    )


def about_size(position: Floats, stamps_ns: Ints | None) -> str | None:
    """Millimetres or centimetres as metres: pictures (N, 3) far apart, or a camera that flies."""
    remedy = "if positions are in millimetres or centimetres, name their columns x_mm, y_mm or x_cm, y_cm"
    if len(position) < LEAST or np.abs(position).max() > GEOREFERENCED_M:
        return None
    apart = float(np.median(_nearest(position)))
    whole = bool((position[:, :2] == np.rint(position[:, :2])).all())
    if not np.isfinite(apart):
        return None  # one place
    if apart >= (FAR_APART_WHOLE_M if whole else FAR_APART_M):
        return f"neighbours lie {apart:.4g} m apart; {remedy}"
    if stamps_ns is None:
        return None
    step, time = np.linalg.norm(np.diff(position, axis=0), axis=1), np.diff(stamps_ns)
    on_a_way = np.median(step) < 0.05 * np.linalg.norm(np.ptp(position, axis=0))  # random poses have no speed
    if not on_a_way or (time < SHORTEST_NS).any() or (time == TENTH_S).all():
        return None
    speed = float(np.median(step / (time / 1e9)))
    return f"the camera moves at {speed:.4g} m/s; {remedy}" if speed > FASTEST_M_S else None


def _nearest(position: Floats) -> Floats:
    """Distances from some of the positions (N, 3) to the nearest other place."""
    some = position[np.unique(np.linspace(0, len(position) - 1, 32).astype(int))]
    away = (np.linalg.norm(position - one, axis=1) for one in some)
    return np.array([distances[distances > 0].min(initial=np.inf) for distances in away])


def about_slips(position: Floats) -> str | None:
    """Single positions of (N, 3) that a path jumps to and back from, far from all others: a digit too many."""
    if len(position) < LEAST:
        return None
    away = np.linalg.norm(position - np.median(position, axis=0), axis=1)
    for count in range(1, min(MOST_SLIPS, max(1, int(SLIPS * len(position)))) + 1):
        rows = np.sort(np.argpartition(away, -count)[-count:])
        others = np.delete(position, rows, axis=0)
        far = max(SLIP_M, SLIP_EXTENTS * float(np.linalg.norm(np.ptp(others, axis=0))))
        nearest = [float(np.linalg.norm(others - position[row], axis=1).min()) for row in rows]
        if min(nearest) > far and (np.diff(rows) > 1).all():
            where = ", ".join(f"{value:.6g}" for value in position[rows[0]])
            which = (
                f"pose {rows[0] + 1} of {len(position)} lies" if count == 1 else f"{count} of {len(position)} poses lie"
            )
            first = "" if count == 1 else f" (number {rows[0] + 1}, say)"
            return f"{which} at {where}{first}, {nearest[0]:.4g} m from all others; mend it if that is a slip"
    return None


def about_times(stamps_ns: Ints | None) -> str | None:
    """Times (N,) in a unit that makes them follow one another faster than any camera can."""
    if stamps_ns is None or len(stamps_ns) < LEAST:
        return None
    apart = float(np.ptp(stamps_ns)) / (len(stamps_ns) - 1)
    if not 0 < apart <= SHORTEST_NS:
        return None
    return (
        f"times are {apart:.4g} nanoseconds apart; if they are in seconds, milliseconds or microseconds, name their column"
        " stamp_s, stamp_ms or stamp_us"
    )


# ------------------------------------------------------------------------------------------------------------ rotations
def about_quaternions(T: Floats, turn: tuple[str, ...]) -> str | None:
    """Quaternions with the real part first, read as last: a robot on a floor tips over as it turns."""
    if turn != QUATERNION or len(T) < LEAST or np.median(T[:, 2, 2]) > TIPPED:
        return None
    x, y, z, w = quaternion_xyzw(T).T
    other = rotation_of_quaternion(np.stack([y, z, w, x], -1))
    if (other[:, 2, 2] < UPRIGHT).any() or _resultant(heading_of(other)) > 0.999:
        return None
    return (
        "the poses tip over as they turn, but stay upright if the real part of the quaternions is the first of their four"
        " numbers; if so, write it last (or name the columns of a CSV qw, qx, qy, qz)"
    )


def about_camera_axes(path: Trajectory) -> str | None:
    """Poses in the axes of a camera (x right, y down, z ahead), such as KITTI's, where z is up."""
    T = path.T_world_camera
    if len(T) < LEAST or T[:, 1, 1].min() < 0.9 or _resultant(np.arctan2(T[:, 0, 2], T[:, 2, 2])) > 0.9:
        return None
    extent = np.ptp(T[:, :3, 3], axis=0)
    if extent[2] < 3 * extent[1]:
        return None
    command = CAMERA_AXES.get((path.turn, path.stamps_ns is None), "")
    return (
        "the poses turn about y and move along z, which is up; if their axes are those of a camera, z ahead and y down (KITTI's"
        f" are), make x, y, z of positions and rotations z, -x, -y{command}"
    )


CAMERA_AXES = {  # by what gives the rotation, and whether there are no times: a command for the file's format
    (MATRIX, True): ": awk '{print $11,-$9,-$10,$12,-$3,$1,$2,-$4,-$7,$5,$6,-$8}' OLD > NEW",
    (QUATERNION, False): ": awk '{print $1,$4,-$2,-$3,$7,-$5,-$6,$8}' OLD > NEW",
}


def in_other_unit(path: Trajectory) -> Floats | None:
    """The headings (N,) that the numbers of a column are if degrees are radians, or radians degrees; None where they cannot."""
    numbers = path.numbers
    if numbers is None or len(numbers) < LEAST or path.turn not in UNITS:
        return None
    most, other = UNITS[path.turn], numbers
    if path.turn == ("yaw_rad",):
        if np.abs(numbers).max() <= most:
            return None
        other = np.deg2rad(numbers)
    elif np.abs(numbers).max() > most:
        return None
    return None if _resultant(other) > ALIKE else np.pi / 2 - other if path.turn == ("heading_deg",) else other


UNITS = {  # the largest number that may be radians in a column of degrees, and is not too large in one of radians
    ("yaw_deg",): 60.0,
    ("heading_deg",): 60.0,
    ("yaw_rad",): 2 * np.pi + 0.01,
}


def look_like_radians(path: Trajectory) -> bool:
    """Whether all numbers in a column of degrees lie within one turn in radians, and all around it."""
    numbers = path.numbers
    if numbers is None or path.turn == ("yaw_rad",) or in_other_unit(path) is None:
        return False
    return bool(np.abs(numbers).max() <= 3.15 or (numbers.min() > -1e-6 and numbers.max() <= 6.29))


def unit_remedy(path: Trajectory) -> str:
    """The question whether a column holds numbers of another unit, without the reason."""
    (name,) = path.turn
    if name == "yaw_rad":
        return "numbers in yaw_rad are large for radians; if they are degrees, name it yaw_deg"
    right = "yaw_rad" if name == "yaw_deg" else "yaw_rad (and count from +x, counter-clockwise)"
    return f"all numbers in {name} are as small as radians are; if they are radians, name it {right}"


def about_units(path: Trajectory) -> str | None:
    """Radians as degrees, or degrees as radians: read so, they turn with the path."""
    headings = in_other_unit(path)
    if headings is None:
        return None
    so, other = with_travel(path), with_travel(path, headings)
    if so is None or other is None or not (other.agreement >= AGREE and so.agreement <= APART):
        return None
    return f"{unit_remedy(path)}: then they turn with the path"


def about_turns(path: Trajectory, clockwise: str) -> str | None:
    """Headings against the directions of travel: clockwise, or positions in a left-handed frame."""
    so, other = with_travel(path), with_travel(path, -heading_of(path.T_world_camera))
    if so is None or other is None or not (other.agreement >= AGREE and so.agreement <= APART):
        return None
    return f"{AGAINST}; if they run clockwise, {clockwise_remedy(path, clockwise)}; if not, {SWAPPED}"


def clockwise_remedy(path: Trajectory, remedy: str) -> str:
    """What to do with headings that run the other way than they are read: `remedy`, unless a column's name does it."""
    if path.turn == ("heading_deg",):
        return "counter-clockwise that is, name it yaw_deg"
    if path.turn and not path.turn[0].startswith("yaw"):
        return "turn them round (rotations may be from world to camera)"
    other = with_travel(path, -heading_of(path.T_world_camera))
    compass = other is not None and other.agreement >= AGREE and abs(other.offset_deg - 90) < 20
    return "from north, name it heading_deg" if compass and path.turn == ("yaw_deg",) else remedy


class WithTravel(NamedTuple):
    """How headings go with the directions of travel."""

    agreement: float  # mean resultant length: 1 if they differ by a constant
    offset_deg: float  # that constant: the direction of travel, counter-clockwise from the heading


def with_travel(path: Trajectory, headings: Floats | None = None) -> WithTravel | None:
    """Headings (N,), or those of the path, against directions of travel; None where a path does not turn enough to tell."""
    position = path.T_world_camera[:, :2, 3]
    turns = np.exp(1j * (heading_of(path.T_world_camera) if headings is None else headings))
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(position, axis=0), axis=1))])
    ends = np.unique(np.searchsorted(arc, np.linspace(0, arc[-1], STRETCHES + 1)).clip(0, len(arc) - 1))
    chord = np.diff(position[ends] @ np.array([1, 1j]))
    straight = np.abs(chord) > 0.5 * np.diff(arc[ends])
    if straight.sum() < LEAST:
        return None
    sums = np.concatenate([[0], np.cumsum(turns)])
    along = (sums[ends[1:] + 1] - sums[ends[:-1]])[straight]
    travel = np.angle(chord[straight])
    if _resultant(travel) > ALIKE:
        return None
    mean = np.exp(1j * (travel - np.angle(along))).mean()
    return WithTravel(float(np.abs(mean)), float(np.rad2deg(np.angle(mean))))


def _resultant(angles_rad: Floats) -> float:
    return float(np.abs(np.exp(1j * angles_rad).mean()))
