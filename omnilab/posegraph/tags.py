"""The words that lines of g2o and TORO files start with, the numbers after them, and words that mean more than is read."""

from __future__ import annotations

import re
from typing import NamedTuple

from omnilab.errors import did_you_mean


class Tag(NamedTuple):
    """What a line's first word says."""

    ids: int  # 1: a vertex, 2: an edge
    k: int  # numbers of a pose or motion
    upper: tuple[int, ...] = ()  # where the information's upper triangle, row by row, stands among the numbers after


UPPER, LOWER, TORO = "the upper triangle, row by row", "the lower triangle, row by row", "TORO's xx xy yy hh xh yh"
ORDERS = {
    3: {UPPER: tuple(range(6)), LOWER: (0, 1, 3, 2, 4, 5), TORO: (0, 1, 4, 2, 5, 3)},
    7: {
        UPPER: tuple(range(21)),
        LOWER: (0, 1, 3, 6, 10, 15, 2, 4, 7, 11, 16, 5, 8, 12, 17, 9, 13, 18, 14, 19, 20),
    },
}  # of an information matrix, by the numbers of a pose
TAGS = {
    "VERTEX_SE2": Tag(1, 3),
    "EDGE_SE2": Tag(2, 3, ORDERS[3][UPPER]),
    "VERTEX_SE3:QUAT": Tag(1, 7),
    "EDGE_SE3:QUAT": Tag(2, 7, ORDERS[7][UPPER]),
    "VERTEX2": Tag(1, 3),
    "EDGE2": Tag(2, 3, ORDERS[3][TORO]),
}
SKIPPED = ("EQUIV", "FIX")  # TORO: two names of a place; g2o: the vertex that stays, and here the first one does
NOT_READ = {
    r"PRIOR": ("a prior on a vertex", "remove these lines; the first vertex stays"),
    r"^PARAMS": ("a sensor's place on the robot", "remove these lines, and those that use them"),
    r"SWITCH|MAXMIX": ("a switchable loop closure", "write it as a plain edge; backend=gtsam_gnc finds wrong ones"),
    r"^(VERTEX|EDGE)3$": ("of TORO in space, with Euler angles", "write VERTEX_SE3:QUAT and EDGE_SE3:QUAT"),
    r"SIM3": ("a similarity, with a scale", "write VERTEX_SE3:QUAT and EDGE_SE3:QUAT"),
    r"LASER": ("a laser scan", "remove these lines"),
    r"XY|POINT|LANDMARK|BEARING|RANGE|LINE|SEGMENT|PLANE|PROJECT|CAM|^BR$": (
        "about landmarks", "remove these lines, and leave poses and the motions between them",
    ),
}  # words of g2o, TORO and their kin, what they are, and what to do with them  # fmt: skip


def refusal(word: str) -> tuple[str, str]:
    """What is wrong with a word that is no tag, and what fixes it."""
    for pattern, (what, remedy) in NOT_READ.items():
        if re.search(pattern, word):
            return f"is {word[:40]}, {what}, which is not read", remedy
    hint = did_you_mean(word, TAGS) or did_you_mean(word.upper(), TAGS)
    return f"starts with {word[:40]!r}{hint}", f"known are {', '.join([*TAGS, *SKIPPED])}"
