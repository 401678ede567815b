"""Checks of single values: `Wrong` in a few words where one is not as the contract says."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np
import numpy.typing as npt

KINDS = {  # kinds of NumPy's types
    "float": "f", "float32": "f", "float64": "f", "whole": "iu", "int64": "i", "bool": "b", "uint8": "u", "number": "fiu"
}  # fmt: skip
EXACTLY = {"float32", "float64", "int64", "uint8"}
LARGEST = 8  # bytes of a number: no library takes longer ones
PLAIN = (np.ndarray, np.memmap)  # no masked arrays and no matrices
ITEMS = "items"  # what `Wrong` calls images, queries, ...; who catches it knows which
SMALL = 16  # numbers, as poses and their covariances have
RIGID = 1e-3  # how far R R^T may be from the identity
Shape = tuple[Any, ...]  # of numbers, or None for any number; ends in ... where more axes may follow


class Wrong(Exception):
    """What is wrong with a value, in words that follow "returns"."""

    def __init__(self, text: str, item: int | None = None) -> None:
        super().__init__(text)
        self.item = item  # the first of the images, queries, ... that it is about


def typed(value: Any, expected: type[Any]) -> None:
    """Wrong unless a value is of a type."""
    if not isinstance(value, expected):
        raise Wrong(f"{named(value)}, not {expected.__name__}")


def named(value: Any) -> str:
    """A value's type, and of an array what there is to know."""
    if isinstance(value, np.ndarray):
        kind = "an array" if type(value) in PLAIN else type(value).__name__
        return f"{kind} of {value.dtype} {value.shape}"
    return "None" if value is None else type(value).__name__


def array(
    value: Any, name: str, shape: Shape, kind: str = "float", nan: bool = False, inf: bool = False
) -> npt.NDArray[Any]:
    """An array as it is; Wrong unless it has that shape, that kind of numbers, and no NaN or infinity but if allowed."""
    if type(value) not in PLAIN:
        raise Wrong(f"{name} as {named(value)}, not as {_plain_array(value)} {shown(shape)}")
    found: npt.NDArray[Any] = value
    if (
        found.dtype.kind not in KINDS[kind]
        or found.dtype.itemsize > LARGEST
        or (kind in EXACTLY and found.dtype != kind)
    ):
        raise Wrong(f"{name} of type {found.dtype}, not {kind}")
    if not found.dtype.isnative:
        raise Wrong(f"{name} of type {found.dtype.str}, not in this machine's byte order")
    if not _fits(found.shape, shape):
        raise Wrong(f"{name} of shape {found.shape}, not {shown(shape)}")
    if found.dtype.kind == "f" and not (nan and inf):
        _finite(found, name, nan, inf)
    return found


def _plain_array(value: Any) -> str:
    """An array may hide some of its numbers, or multiply as a matrix."""
    return "a plain array" if isinstance(value, np.ndarray) else "an array"


def _fits(shape: tuple[int, ...], expected: Shape) -> bool:
    if expected and expected[-1] is ...:
        expected = expected[:-1]
        shape = shape[: len(expected)] if len(shape) >= len(expected) else shape
    if len(shape) != len(expected):
        return False
    return not [side for side, wanted in zip(shape, expected, strict=True) if wanted is not None and wanted != side]


def shown(shape: Shape) -> str:
    """A shape in words: (10, 3), (10, any, ...)."""
    sides = ["..." if side is ... else "any" if side is None else str(side) for side in shape]
    return f"({', '.join(sides)}{',' if len(sides) == 1 else ''})"


def _finite(values: npt.NDArray[Any], name: str, nan: bool, inf: bool) -> None:
    if values.size <= SMALL and all(map(math.isfinite, values.ravel().tolist())):  # quicker than NumPy, of so few
        return
    bad = np.isinf(values) if nan else np.isnan(values) if inf else ~np.isfinite(values)
    if not bad.any():
        return
    what = "infinity" if nan else "NaN" if inf else "NaN or infinity"
    rows = np.flatnonzero(bad.reshape(len(bad), -1).any(axis=1)) if bad.ndim else np.zeros(1, int)
    share = f"{100 * float(bad.mean()):.3g} % of all numbers"
    where = f", in {len(rows)} of {len(bad)} {ITEMS}, the first is number {rows[0]}" if bad.ndim else ""
    raise Wrong(f"{what} in {name} ({share}{where})", int(rows[0]))


def within(values: npt.NDArray[Any], name: str, count: int | None, of: str) -> None:
    """Wrong unless whole numbers are indices of `count` things; None: of any number."""
    bad = values < 0 if count is None else (values < 0) | (values >= count)
    if bad.any():
        first = int(np.flatnonzero(bad.ravel())[0])
        limit = "from 0" if count is None else f"from 0 to {count - 1}" if count else "none, for there are none"
        raise Wrong(f"{name} {values.ravel()[first]}, which is no index of {of} ({limit})", first)


def rotations(value: Any, name: str, shape: tuple[int, ...]) -> None:
    """Wrong unless there are rotation matrices (*shape, 3, 3)."""
    off = _are_no_rotations(array(value, name, (*shape, 3, 3)).reshape(-1, 3, 3))
    if off.any():
        raise Wrong(
            f"{name} that are no rotation matrices ({int(off.sum())} of {off.size}, the first is number"
            f" {int(np.flatnonzero(off)[0])})"
        )


def _are_no_rotations(R: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
    """Which of (N, 3, 3) are no rotation matrices, (N)."""
    off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2), initial=0) > RIGID
    return np.asarray(off | (np.linalg.det(R) < 0))


def poses(value: Any, name: str, count: int) -> None:
    """Wrong unless there are so many poses (count, 4, 4), all rigid motions."""
    T = array(value, name, (count, 4, 4))
    if not count:
        return
    off = _are_no_rotations(T[:, :3, :3])
    off |= (np.abs(T[:, 3] - [0, 0, 0, 1]) > RIGID).any(axis=1)
    if off.any():
        first = int(np.flatnonzero(off)[0])
        raise Wrong(
            f"{name} that are no rigid motions ({int(off.sum())} of {count} {ITEMS}, the first is number {first}): each is a"
            " rotation matrix, a position, and a last row of 0 0 0 1",
            first,
        )


def covariances(value: Any, name: str, count: int, size: int, definite: bool = False) -> None:
    """Wrong unless there are so many covariances (count, size, size), symmetric, without negative variances.

    `definite`: none of which is singular, so that they can be inverted.
    """
    C = array(value, name, (count, size, size))
    if not _are_definite(C):
        _check_covariances(C, name, definite)


def _are_definite(C: npt.NDArray[Any]) -> bool:
    """Whether all covariances (N, k, k) are symmetric and positive definite, which most are and this sees quickly."""
    if C.size <= SMALL:
        return all(map(_is_definite, C.tolist()))
    with suppress(np.linalg.LinAlgError):
        if np.array_equal(C, C.transpose(0, 2, 1)):
            np.linalg.cholesky(C)
            return True
    return False


def _is_definite(rows: list[list[float]]) -> bool:
    """The same of one, by Cholesky's decomposition: all that is left on the diagonal is positive."""
    while rows:
        first, *others = rows
        if not first[0] > 0 or any(row[0] != value for row, value in zip(others, first[1:], strict=True)):
            return False
        rows = [
            [value - row[0] * above / first[0] for value, above in zip(row[1:], first[1:], strict=True)]
            for row in others
        ]
    return True


def _check_covariances(C: npt.NDArray[Any], name: str, definite: bool) -> None:
    """Wrong unless covariances (N, k, k) are symmetric but for rounding, without negative variances."""
    count = len(C)
    scale = np.maximum(np.abs(C).max(axis=(1, 2)), 1e-300)
    unit = C / scale[:, None, None]
    off = np.abs(unit - unit.transpose(0, 2, 1)).max(axis=(1, 2)) > RIGID
    least = np.linalg.eigvalsh(unit)[:, 0]
    off |= least <= 0 if definite else least < -RIGID
    off |= (np.diagonal(C, axis1=1, axis2=2) < 0).any(axis=1)
    if off.any():
        first = int(np.flatnonzero(off)[0])
        wanted = "symmetric and positive definite" if definite else "symmetric, and no variance of theirs is negative"
        which = f" (the first is number {first})" if count > 1 else ""
        raise Wrong(f"{name} that are no covariances{which}; each is {wanted}", first)


def covariance(value: Any, name: str, size: int, definite: bool = False) -> None:
    """Wrong unless a value is one covariance (size, size)."""
    C = array(value, name, (size, size))[None]
    if not _are_definite(C):
        _check_covariances(C, name, definite)


def number(value: Any, name: str, nan: bool = False, inf: bool = False) -> None:
    """Wrong unless a value is one finite number; `nan`, `inf`: or NaN, or infinite."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise Wrong(f"{name} as {named(value)}, not as a number")
    try:
        found = float(value)
    except OverflowError:
        raise Wrong(f"{name} as a whole number that no float holds") from None
    if not (np.isfinite(found) or (nan and np.isnan(found)) or (inf and np.isinf(found))):
        raise Wrong(f"{name} {found}, not a finite number")


def whole(value: Any, name: str) -> None:
    """Wrong unless a value is a whole number from 0."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise Wrong(f"{name} as {named(value)}, not as a whole number")
    if value < 0:
        raise Wrong(f"{name} {value}, below 0")


def sentences(value: Any, name: str) -> None:
    """Wrong unless a value is a sequence of texts."""
    if isinstance(value, str) or not isinstance(value, Sequence):
        raise Wrong(f"{name} as {named(value)}, not as a sequence of texts")
    for i, text in enumerate(value):
        if not isinstance(text, str):
            raise Wrong(f"{name} of which number {i} is {named(text)}, not a text", i)


def unit(value: Any) -> None:
    """Wrong unless a value says in what lengths are."""
    text(value, "`unit`")
    if not value.strip():
        raise Wrong("no `unit`; say 'm', or what it counts")


def flag(value: Any, name: str) -> None:
    """Wrong unless a value is True or False."""
    if not isinstance(value, bool):
        raise Wrong(f"{name} as {named(value)}, not as True or False")


def between(values: npt.NDArray[Any], name: str, low: float, high: float) -> None:
    """Wrong where numbers leave an interval; NaN does not."""
    off = (values < low) | (values > high)
    if off.any():
        first = int(np.argwhere(off)[0][0])
        raise Wrong(f"{name} outside of [{low:g}, {high:g}], the first is number {first}", first)


def unit_vectors(values: npt.NDArray[Any], name: str, what: str = "is no unit vector") -> None:
    """Wrong unless vectors (N, 3) or quaternions (N, 4) have the length 1."""
    off = np.abs(np.linalg.norm(values, axis=1) - 1) > RIGID
    if off.any():
        first = int(np.flatnonzero(off)[0])
        raise Wrong(f"{name} of which number {first} {what}: {values[first]}", first)


def text(value: Any, name: str, lines: bool = False) -> None:
    """Wrong unless a value is a text that can be written; `lines`: of several lines."""
    if not isinstance(value, str):
        raise Wrong(f"{name} as {named(value)}, not as a text")
    try:
        value.encode()
    except UnicodeEncodeError:
        raise Wrong(f"{name} {value!a:.80}, which holds half a character") from None
    if "\0" in value or not (lines or value.isprintable()):
        raise Wrong(f"{name} {value!a:.80}, which holds characters that nobody sees")
