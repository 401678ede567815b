"""Columns that look like one of the vocabulary but are none: which quantity each means, and what to write instead.

A column is misnamed only if nothing else gives its quantity: `theta` beside `yaw_deg` is a column like any other.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import product

from omnilab.trajectory.columns import COLUMNS, LENGTHS, ROTATIONS, STAMPS

UNITS = {  # words at the end of a name, after the unit that they mean
    "m": "m meter meters metre metres",
    "cm": "cm centimeter centimeters centimetre centimetres",
    "mm": "mm millimeter millimeters millimetre millimetres",
    "km": "km ft feet inch inches yd",
    "deg": "deg degs degree degrees",
    "rad": "rad rads radian radians",
    "s": "s sec secs second seconds",
    "ms": "ms msec msecs millis milliseconds",
    "us": "us usec usecs micros microseconds",
    "ns": "ns nsec nsecs nanosec nanos nanoseconds",
}
UNIT_OF = {word: unit for unit, words in UNITS.items() for word in words.split()}
IN_FRONT = {
    "field",
    "header",
    "pose",
    "robot",
    "gt",
    "gps",
    "gnss",
    "cam",
    "camera",
    "odom",
    "utm",
    "world",
    "map",
    "p",
}
COMPASS = {"heading", "azimuth", "bearing", "hdg", "compass"}
MEANINGS = {  # words without what stands in front and without a unit, after the quantity that they mean
    **{a: f"{a} pos_{a} position_{a} {a}_pos {a}_position p{a} t{a} t_{a} rs_r_{a}" for a in "xy"},
    "z": "z pos_z position_z z_pos z_position pz tz t_z rs_r_z height altitude alt elevation",
    "easting": "easting east",
    "northing": "northing north",
    "globe": "lat latitude lon lng long longitude",
    "heading": "yaw theta psi phi angle rotation rot orientation yaw_angle orientation_yaw euler_z rot_z rotation_z "
    "heading azimuth bearing hdg compass heading_angle",
    "rotation": "roll pitch rx ry rz euler_x euler_y",
    "quaternion": " ".join(f"q{a} q_{a} quat_{a} quaternion_{a} orientation_{a} q_rs_{a} o{a}" for a in "xyzw")
    + " q0 q1 q2 q3 q_0 q_1 q_2 q_3",
    "matrix": " ".join(f"r{i}{j} r_{i}{j}" for i, j in product(range(4), range(4))),
    "time": "timestamp time_stamp stamp time t ts unix_time unixtime epoch",
    "ix": "ix i_x grid_x cell_x",
    "iy": "iy i_y grid_y cell_y",
    "image": "image file filename file_name img images image_name image_file image_path img_path img_name path name picture",
}
MEANING_OF = {word: quantity for quantity, words in MEANINGS.items() for word in words.split()}
PART_OF = {  # quantities that are one of a given one
    **dict.fromkeys(("easting", "globe"), "x"),
    "northing": "y",
    **dict.fromkeys(("rotation", "quaternion", "matrix"), "heading"),
}
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
LEFT = "counter-clockwise from +x"
HEADINGS = f"yaw_deg ({LEFT}), yaw_rad (the same in radians) or heading_deg (clockwise from north, +y)"


def misnamed(header: Sequence[str], row: Sequence[str]) -> tuple[str, str] | None:
    """The first column that is taken for one of the vocabulary, and what to do; None if there is no such column.

    `row` are the first values: what is no number (and no time of day) is a label, not a coordinate.
    """
    given = _given(header)
    for name, value in zip(header, row, strict=True):
        remedy = None if name in COLUMNS else remedy_for(name, given)
        if remedy and (NUMBER.fullmatch(value.strip()) or re.search(r"\d:\d", value)):
            return name, remedy
    return None


def image_column(header: Iterable[str]) -> str | None:
    """The column that may have been meant to be `image`."""
    return next((name for name in header if _meaning(name)[0] == "image"), None)


def remedy_for(name: str, given: Collection[str] = ()) -> str | None:
    """What to write instead of a name that looks like one of the vocabulary; None if it looks like none that is needed.

    `given` are the quantities that other columns give.
    """
    quantity, unit, word = _meaning(name)
    if quantity is None or quantity == "image" or PART_OF.get(quantity, quantity) in given:
        return None
    plain = _plain(name)
    if plain in COLUMNS:
        return f"name it {plain}"
    match quantity:
        case "globe":
            return "degrees are no metres: project them (to UTM, say) and write x_m and y_m"
        case "x" | "y" | "z" | "easting" | "northing":
            axis = PART_OF.get(quantity, quantity)
            if unit in {"m", "cm", "mm"}:
                return f"name it {axis}_{unit}"
            return f"write {axis}_m (in metres), {axis}_cm or {axis}_mm"
        case "heading":
            if unit is None or (unit == "rad" and word in COMPASS):
                return f"write {HEADINGS}"
            if unit == "rad":
                return f"name it yaw_rad ({LEFT})"
            return f"write {HEADINGS}" if word in COMPASS else f"name it yaw_deg ({LEFT})"
        case "rotation":
            return "write rx_deg, ry_deg, rz_deg (Rx Ry Rz) or qx, qy, qz, qw"
        case "quaternion":
            return "write qx, qy, qz, qw (w is the real part)"
        case "matrix":
            return "write r00, r01, ... r22, counted from 0"
        case "time":
            return f"name it stamp_{unit}" if unit in {"s", "ms", "us", "ns"} else f"write {', '.join(STAMPS)}"
        case _:
            return f"name it {quantity}"


def _given(header: Iterable[str]) -> set[str]:
    """The quantities that the columns of the vocabulary give."""
    turns = {name for columns in ROTATIONS for name in columns}
    meanings: Mapping[str, str] = {
        **{name: axis for name, (axis, _) in LENGTHS.items()},
        **dict.fromkeys(turns, "heading"),
        **dict.fromkeys(STAMPS, "time"),
        **{name: name for name in ("image", "ix", "iy")},
    }
    return {meanings[name] for name in header if name in meanings}


def _meaning(name: str) -> tuple[str | None, str | None, str]:
    """The quantity that a name means and the unit that it ends in, where it has such; and the word for the quantity."""
    words = _plain(name).split("_")
    while len(words) > 1 and words[0] in IN_FRONT:
        words = words[1:]
    plain = "_".join(words)
    if plain in MEANING_OF:
        return MEANING_OF[plain], None, plain
    unit = UNIT_OF.get(words[-1])
    word = "_".join(words[:-1])
    if unit is not None and word in MEANING_OF:
        return MEANING_OF[word], unit, word
    return None, None, plain


def _plain(name: str) -> str:
    """Lower case, with single underscores between words: `Yaw (deg)`, `yawDeg` and `YAW-DEG` are yaw_deg."""
    apart = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name)
    return re.sub(r"[^a-z0-9]+", "_", apart.lower()).strip("_")
