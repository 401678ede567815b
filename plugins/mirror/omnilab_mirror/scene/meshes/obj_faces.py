"""Faces of OBJ files, read byte by byte."""

from __future__ import annotations

from typing import Any

import numpy.typing as npt

from omnilab_mirror.compiled import compiled

Array = npt.NDArray[Any]
FINE, INDEX, OTHER = 0, 1, 2  # problems: an index of 0, anything else
HIGHEST = 2_000_000_000  # index


@compiled
def parse_faces(text: Array, vertex: Array, place: Array, counts: Array) -> tuple[int, int, int]:
    """Fill the indices of each corner and the corners of each line; how many corners there are, a line and its problem.

    Each line of `text` (B,) ends with a line feed and has corners v, v/vt, v//vn or v/vt/vn, parted by blanks.
    """
    found, line, start, i = 0, 0, 0, 0
    while i < len(text):
        c = text[i]
        if c == 10:  # the line ends
            counts[line] = found - start
            line, start, i = line + 1, found, i + 1
        elif c == 32:
            i += 1
        elif c == 35:  # a comment
            while text[i] != 10:
                i += 1
        else:
            part, number, digits = 0, 0, 0
            vertex[found], place[found] = 0, 0
            while True:
                c = text[i]
                if 48 <= c <= 57:
                    number, digits = number * 10 + (c - 48), digits + 1
                    if number > HIGHEST:
                        return found, line, OTHER
                elif c in {47, 32, 10, 35}:
                    if part == 0:
                        if digits == 0:
                            return found, line, OTHER
                        if number == 0:
                            return found, line, INDEX
                        vertex[found] = number
                    elif part == 1:
                        place[found] = number
                    if c != 47:
                        break
                    part, number, digits = part + 1, 0, 0
                    if part > 2:
                        return found, line, OTHER
                else:
                    return found, line, OTHER
                i += 1
            found += 1
    return found, line, FINE
