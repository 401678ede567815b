"""Text of OBJ files taken apart byte by byte, where its lines are as most are; what is not is left to `obj`."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from omnilab_mirror.compiled import compiled, inlined
from omnilab_mirror.scene.meshes.obj_faces import HIGHEST

Array = npt.NDArray[Any]
EXACT = 2**53  # whole numbers up to it are exact in 64 bits, and so are powers of ten up to the 22nd
POWERS = 10.0 ** np.arange(23)
WORDS = np.zeros(256, np.bool_)  # first bytes of lines that may be about shapes
WORDS[[ord("v"), ord("f"), *range(10), *range(11, 33)]] = True


class Scan(NamedTuple):
    """What some lines hold."""

    vertices: Array  # (n, 3), or with colours (n, 6)
    places: Array  # (n, 2)
    vertex: Array  # of each corner, from 1
    place: Array  # of each corner, from 1; 0 is none
    counts: Array  # corners of each face
    line: Array  # of each face, from 0
    others: Array  # (n, 2): where other lines start, and how many faces are before


def scanned(text: bytes, vertices: int, places: int) -> Scan | None:
    """The lines of a text, before which are so many vertices and texture coordinates; None where one is out of the ordinary."""
    cells = np.frombuffer(text + b"\n", np.uint8)
    lines, corners = text.count(b"\n") + 1, len(cells) // 2 + 1
    numbers, late = (np.empty((lines, 6)), np.empty((lines, 2))), np.empty((6 * lines, 5), np.int64)
    of_corners = np.empty(corners, np.int32), np.empty(corners, np.int32)
    of_lines = np.empty(lines, np.int32), np.empty(lines, np.int32), np.empty((lines, 2), np.int64)
    found = scan(cells, (vertices, places), numbers, late, of_corners, of_lines)
    if found[0] < 0:
        return None
    width, rows, at, faces, ends, others, slow = found
    for kind, row, column, start, end in late[:slow].tolist():
        numbers[kind][row, column] = float(text[start:end])
    return Scan(
        numbers[0][:rows, :width].copy(), numbers[1][:at].copy(), of_corners[0][:ends].copy(), of_corners[1][:ends].copy(),
        of_lines[0][:faces].copy(), of_lines[1][:faces].copy(), of_lines[2][:others].copy(),
    )  # fmt: skip


@compiled
def decimal(text: Array, i: int) -> tuple[float, int, bool]:
    """The number that begins at i, where it ends (-1: it is none), and whether it is exact, correctly rounded."""
    negative = text[i] == 45
    i += text[i] in (43, 45)
    value, digits, places, exact = 0, 0, 0, True
    behind = False
    while 48 <= text[i] <= 57 or (text[i] == 46 and not behind):
        if text[i] == 46:
            behind = True
        else:
            digits, places = digits + 1, places + behind
            value = value * 10 + (text[i] - 48)
            if value > EXACT:
                value, exact = 0, False
        i += 1
    exponent = 0
    if text[i] in (69, 101) and digits:
        i += 1
        minus = text[i] == 45
        i += text[i] in (43, 45)
        first = i
        while 48 <= text[i] <= 57:
            exponent, i = min(exponent * 10 + (text[i] - 48), 9999), i + 1
        digits = digits if i > first else 0
        exponent = -exponent if minus else exponent
    if digits == 0 or text[i] not in (32, 10):
        return 0.0, -1, False
    exponent -= places
    exact &= -22 <= exponent <= 22
    if not exact:
        return 0.0, i, False
    number = value * POWERS[exponent] if exponent >= 0 else value / POWERS[-exponent]
    return -number if negative else number, i, True


@compiled
def corner(text: Array, i: int, known: tuple[int, int]) -> tuple[int, int, int]:
    """The indices, from 1, of a corner's vertex and texture coordinate (0: none), and where it ends; -1: it is none."""
    vertex, place, part = 0, 0, 0
    while part < 3:
        negative = text[i] == 45
        i += negative
        number, first = 0, i
        while 48 <= text[i] <= 57 and number <= HIGHEST:
            number, i = number * 10 + (text[i] - 48), i + 1
        if i == first and (negative or part == 0):
            break
        if part == 0:
            vertex = known[0] + 1 - number if negative else number
            if vertex <= 0:
                break
        elif part == 1:
            place = known[1] + 1 - number if negative else number
            if place < 0 or (negative and place == 0) or number > HIGHEST:
                break
        if text[i] in (32, 10):
            return (vertex, place, i) if vertex <= HIGHEST else (0, 0, -1)
        if text[i] != 47:
            break
        i, part = i + 1, part + 1
    return 0, 0, -1


@inlined
def scan_face(
    text: Array, i: int, known: tuple[int, int], of_corners: tuple[Array, Array], ends: int
) -> tuple[int, int]:
    """Add the corners of the face from i on, of which there are `ends`; where its line ends (-1: it is odd), and how many there are."""
    vertex, place = of_corners
    while text[i] != 10:
        if text[i] == 32:
            i += 1
            continue
        vertex[ends], place[ends], i = corner(text, i, known)
        if i < 0:
            break
        ends += 1
    return i, ends


@inlined
def scan_numbers(text: Array, i: int, kind: int, row: int, out: Array, late: Array, slow: int) -> tuple[int, int, int]:
    """Fill a row of `out` (n, K) with the numbers from i on; where their line ends (-1: it is odd), how many there are, and `slow`.

    A texture coordinate (kind 1) may have a third, which is not kept.
    """
    found, kept = 0, out.shape[1]
    while text[i] != 10:
        if text[i] == 32:
            i += 1
            continue
        at = i
        value, i, exact = decimal(text, at)
        if i < 0 or found == kept + kind:
            return -1, found, slow
        if found < kept:
            out[row, found] = value
            if not exact:
                if slow == len(late):
                    return -1, found, slow
                late[slow, 0], late[slow, 1], late[slow, 2], late[slow, 3], late[slow, 4] = kind, row, found, at, i
                slow += 1
        found += 1
    return i, found, slow


@inlined
def scan_other(text: Array, start: int) -> tuple[int, bool]:
    """Where a line that is neither of a face nor of numbers ends (-1: it is odd), and whether it means something."""
    i = start
    while text[i] != 10:
        i += 1
    normal = text[start] == 118 and text[start + 1] == 110 and text[start + 2] == 32  # vn
    if (i > start and text[i - 1] == 92) or (WORDS[text[start]] and not normal):  # a line that goes on, or is odd
        return -1, False
    return i, not normal and text[start] not in (10, 35)  # neither empty nor a comment


@compiled
def scan(
    text: Array,
    before: tuple[int, int],
    numbers: tuple[Array, Array],
    late: Array,
    of_corners: tuple[Array, Array],
    of_lines: tuple[Array, Array, Array],
) -> tuple[int, int, int, int, int, int, int]:
    """Fill the arrays, of which `late` are numbers that this cannot round; how much is in each, or -1 of an odd line."""
    odd = (-1, 0, 0, 0, 0, 0, 0)
    vertices, uv = numbers
    counts, face_line, others = of_lines
    width, rows, at, faces, ends, other, slow, line, i = 0, 0, 0, 0, 0, 0, 0, 0, 0
    while i < len(text):
        while text[i] == 32:
            i += 1
        start = i
        if text[i] == 102 and text[i + 1] == 32:  # f
            first = ends
            i, ends = scan_face(text, i + 1, (before[0] + rows, before[1] + at), of_corners, ends)
            counts[faces], face_line[faces], faces = ends - first, line, faces + 1
        elif text[i] == 118 and text[i + 1] == 32:  # v
            i, found, slow = scan_numbers(text, i + 1, 0, rows, vertices, late, slow)
            if found not in (3, 6) or width not in (0, found):
                return odd
            width, rows = found, rows + 1
        elif text[i] == 118 and text[i + 1] == 116 and text[i + 2] == 32:  # vt
            i, found, slow = scan_numbers(text, i + 2, 1, at, uv, late, slow)
            if found < 2:
                return odd
            at += 1
        else:
            i, meant = scan_other(text, i)
            if meant:
                others[other, 0], others[other, 1], other = start, faces, other + 1
        if i < 0:
            return odd
        line, i = line + 1, i + 1
    return width, rows, at, faces, ends, other, slow
