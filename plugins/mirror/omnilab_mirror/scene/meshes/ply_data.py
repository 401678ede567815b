"""The elements of a PLY file as arrays, from text or from bytes of either order; lists may have any lengths."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from omnilab.api import Ints
from omnilab_mirror.compiled import compiled

Array = npt.NDArray[Any]
TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4"}
TYPES |= {"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4"}
TYPES |= {"double": "f8", "float64": "f8"}
FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
MAX_HEADER = 100_000


class PlyError(Exception):
    """What is wrong with the file."""


class Lists(NamedTuple):
    """Lists of several rows, one after the other."""

    values: Array
    counts: Ints  # of each row


@dataclass
class Element:
    """The properties of the rows of one element."""

    scalars: dict[str, Array]
    rows: int
    lists: dict[str, Lists] = field(default_factory=dict)


class Property(NamedTuple):
    """A property as the header declares it; `length` is the type of a list's length, "" where it is no list."""

    name: str
    type: str
    length: str


class Declared(NamedTuple):
    """An element as the header declares it."""

    name: str
    rows: int
    properties: list[Property]


def elements_of(data: bytes, limit: int) -> tuple[list[str], dict[str, Element]]:
    """The comments, and the elements by name; PlyError where the file has less or other than its header says."""
    lines, body = _header(data)
    order, comments, declared = _declared(lines)
    if order is None:
        raise PlyError("its header names no format")
    for element in declared:
        if element.rows > 3 * limit:
            raise PlyError(f"its header announces {element.rows} rows of '{element.name}', up to {3 * limit} are read")
    elements, position = {}, 0
    cells = np.frombuffer(body, np.uint8) if order else _numbers(body)
    for element in declared:
        elements[element.name], position = _element(cells, position, element, order)
    if not order and position != len(cells):
        raise PlyError(f"it has {len(cells)} numbers, and its header announces {position}")
    return comments, elements


def _header(data: bytes) -> tuple[list[str], bytes]:
    data = data.removeprefix(b"\xef\xbb\xbf")
    if data[:3] != b"ply" or data[3:4] not in {b"\n", b"\r"}:
        raise PlyError("it does not begin with 'ply'")
    start = data.find(b"end_header", 0, MAX_HEADER)
    if start < 0:
        raise PlyError(f"no 'end_header' is in its first {MAX_HEADER} bytes")
    end = start + len(b"end_header")
    while data[end : end + 1] in {b" ", b"\t"}:
        end += 1
    # a line end of two bytes where the header has such: the first byte behind it may look like one
    end += 2 if data[end : end + 2] == b"\r\n" and data[3:5] == b"\r\n" else 1
    text = data[:start].decode("latin-1").replace("\r\n", "\n").replace("\r", "\n")
    return text.split("\n")[1:], data[end:]


def _declared(lines: list[str]) -> tuple[str | None, list[str], list[Declared]]:
    """The order of bytes ("" for text), the comments and the elements of a header."""
    order: str | None = None
    comments: list[str] = []
    elements: list[Declared] = []
    for line in filter(None, (line.strip() for line in lines)):
        words = line.split()
        match words:
            case ["comment" | "obj_info", *_]:
                comments.append(line.partition(" ")[2].strip())
            case ["format", name, "1.0"] if name in FORMATS:
                order = FORMATS[name]
            case ["element", name, rows] if rows.isascii() and rows.isdigit() and len(rows) < 15:
                elements.append(Declared(name, int(rows), []))
            case ["property", "list", count, kind, name] if (
                elements and count in TYPES and "f" not in TYPES[count] and kind in TYPES
            ):
                elements[-1].properties.append(Property(name, TYPES[kind], TYPES[count]))
            case ["property", kind, name] if elements and kind in TYPES:
                elements[-1].properties.append(Property(name, TYPES[kind], ""))
            case _:
                raise PlyError(f"its header has the line {line[:60]!r}")
    for element in elements:
        names = [part.name for part in element.properties]
        if len(set(names)) < len(names):
            raise PlyError(f"its element '{element.name}' has a property twice")
    if len({element.name for element in elements}) < len(elements):
        raise PlyError("it has an element twice")
    return order, comments, elements


def _numbers(body: bytes) -> Array:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return np.fromstring(body, sep=" ") if body.strip() else np.empty(0)
    except (ValueError, DeprecationWarning):
        bad = next((word for word in body.split() if not _is_number(word)), b"")
        raise PlyError(f"it has {bad[:40].decode('latin-1')!r} where a number should be") from None


def _is_number(word: bytes) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _element(cells: Array, position: int, declared: Declared, order: str) -> tuple[Element, int]:
    """The rows of an element that begin at a cell, which is a byte or a number, and the cell behind them."""
    sizes = [np.dtype(part.length or part.type).itemsize if order else 1 for part in declared.properties]
    if declared.rows * sum(sizes) > len(cells) - position:
        raise PlyError(f"it ends within the {declared.rows} rows of its element '{declared.name}'")
    element = Element({}, declared.rows)
    if not declared.rows or not declared.properties:
        for part in declared.properties:
            _add(element, part, np.empty(0, part.type), np.empty(0, np.int64))
        return element, position
    lengths = _even_lengths(cells, position, declared, order)
    if lengths is None:
        return _uneven(cells, position, declared, order, element)
    fields: list[Any] = []
    for part, length in zip(declared.properties, lengths, strict=True):
        if part.length:
            fields.append((f"{part.name} count", order + part.length if order else "f8"))
        fields.append((part.name, order + part.type if order else "f8", (length,) if part.length else ()))
    row = np.dtype(fields)
    used = declared.rows * row.itemsize // (1 if order else 8)
    table = cells[position : position + used].view(row) if used else np.empty(declared.rows, row)
    for part, length in zip(declared.properties, lengths, strict=True):
        values = _typed(table[part.name], part)
        _add(element, part, values.reshape(-1), np.broadcast_to(np.int64(length), declared.rows))
    return element, position + used


def _add(element: Element, part: Property, values: Array, counts: Ints) -> None:
    if part.length:
        element.lists[part.name] = Lists(values, counts)
    else:
        element.scalars[part.name] = values


def _typed(values: Array, part: Property) -> Array:
    """Values of the property's type, in this machine's order; numbers of a text that are beyond it are refused."""
    kind = np.dtype(part.type)
    if values.dtype.kind == "f" and kind.kind != "f":
        limits = np.iinfo(kind)
        wrong = ~((values >= limits.min) & (values <= limits.max) & (values == np.floor(values)))
        if wrong.any():
            raise PlyError(f"its property '{part.name}' has {values[wrong][0]:g}, which its type cannot hold")
    with np.errstate(over="ignore"):
        return np.ascontiguousarray(values.astype(kind, copy=False))


def _even_lengths(cells: Array, position: int, declared: Declared, order: str) -> list[int] | None:
    """The lengths of the lists of a row, if all rows have the same; of scalars 1."""
    step = _walk_first(cells, position, declared, order)
    if step is None:
        return None
    lengths, row_cells = step
    if declared.rows * row_cells > len(cells) - position:
        return None
    offset = 0
    for part, length in zip(declared.properties, lengths, strict=True):
        if part.length:
            kind = np.dtype(order + part.length) if order else np.dtype("f8")
            size = kind.itemsize if order else 1
            table = cells[position : position + declared.rows * row_cells].reshape(declared.rows, row_cells)
            counts = np.ascontiguousarray(table[:, offset : offset + size]).view(kind)[:, 0]
            if not (counts == length).all():
                return None
            offset += size
        offset += length * (np.dtype(part.type).itemsize if order else 1)
    return lengths


def _walk_first(cells: Array, position: int, declared: Declared, order: str) -> tuple[list[int], int] | None:
    """The lengths of the lists of the first row, and how many cells it has; None where it goes beyond the end."""
    lengths, start = [], position
    for part in declared.properties:
        length = 1
        if part.length:
            size = np.dtype(part.length).itemsize if order else 1
            if position + size > len(cells):
                return None
            raw = cells[position : position + size]
            value = raw.view(order + part.length)[0] if order else raw[0]
            if not 0 <= value <= len(cells):
                return None
            length, position = int(value), position + size
        lengths.append(length)
        position += length * (np.dtype(part.type).itemsize if order else 1)
    return lengths, position - start


def _uneven(cells: Array, position: int, declared: Declared, order: str, element: Element) -> tuple[Element, int]:
    parts = declared.properties
    sizes = np.array([np.dtype(part.type).itemsize if order else 1 for part in parts])
    counted = np.array([0 if not part.length else np.dtype(part.length).itemsize if order else 1 for part in parts])
    starts, lengths = (np.empty((declared.rows, len(parts)), np.int64) for _ in range(2))
    end = walk(cells, position, sizes, counted, order == ">", starts, lengths)
    if end < 0:
        raise PlyError(f"it ends within the {declared.rows} rows of its element '{declared.name}'")
    for i, part in enumerate(parts):
        values = np.concatenate([*_gathered(cells, starts[:, i], lengths[:, i], part, order), np.empty(0, part.type)])
        _add(element, part, values, lengths[:, i])
    return element, end


def _gathered(cells: Array, starts: Ints, lengths: Ints, part: Property, order: str) -> Iterator[Array]:
    """The values of a property, row by row, in parts."""
    size = np.dtype(part.type).itemsize if order else 1
    step = 1_000_000
    for first in range(0, len(starts), step):
        start, count = starts[first : first + step], lengths[first : first + step]
        within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        at = np.repeat(start, count) + size * within
        raw = cells[at[:, None] + np.arange(size)]
        yield _typed(raw.view(order + part.type)[:, 0] if order else raw[:, 0], part)


@compiled
def walk(cells: Array, position: int, sizes: Array, counted: Array, big: bool, starts: Array, lengths: Array) -> int:
    """Fill where in `cells` the values of each property of each row start, and how many there are; the end, or -1."""
    for row in range(len(starts)):
        for i in range(len(sizes)):
            count = 1
            if counted[i] > 0:
                if position + counted[i] > len(cells):
                    return -1
                if cells.itemsize > 1:  # a text: each cell is a number
                    count = int(cells[position])
                else:
                    count = 0
                    for k in range(counted[i]):
                        byte = cells[position + (k if big else counted[i] - 1 - k)]
                        count = count * 256 + int(byte)
                position += counted[i]
            if count < 0 or position + count * sizes[i] > len(cells):
                return -1
            starts[row, i], lengths[row, i] = position, count
            position += count * sizes[i]
    return position
