"""Checks of single values: `Wrong` in a few words where one is not as the contract says."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

KINDS = {"float": "f", "whole": "iu", "bool": "b", "uint8": "u", "number": "fiu"}  # kinds of NumPy's types
ITEMS = "items"  # what `Wrong` calls images, queries, ...; who catches it knows which
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
        return f"an array of {value.dtype} {value.shape}"
    return "None" if value is None else type(value).__name__


def array(
    value: Any, name: str, shape: Shape, kind: str = "float", nan: bool = False, inf: bool = False
) -> npt.NDArray[Any]:
    """A value as an array; Wrong unless it has that shape, that kind of numbers, and no NaN or infinity but if allowed."""
    found = np.asarray(value) if isinstance(value, list | tuple) else value
    if not isinstance(found, np.ndarray):
        raise Wrong(f"{name} as {named(value)}, not as an array {shown(shape)}")
    if found.dtype.kind not in KINDS[kind] or (kind == "uint8" and found.dtype != np.uint8):
        raise Wrong(f"{name} of type {found.dtype}, not {kind}")
    if not _fits(found.shape, shape):
        raise Wrong(f"{name} of shape {found.shape}, not {shown(shape)}")
    if found.dtype.kind == "f" and not (nan and inf):
        _finite(found, name, nan, inf)
    return found


def _fits(shape: tuple[int, ...], expected: Shape) -> bool:
    if expected and expected[-1] is ...:
        expected = expected[:-1]
        shape = shape[: len(expected)] if len(shape) >= len(expected) else shape
    return len(shape) == len(expected) and all(e in (None, n) for n, e in zip(shape, expected, strict=True))


def shown(shape: Shape) -> str:
    """A shape in words: (10, 3), (10, any, ...)."""
    sides = ["..." if side is ... else "any" if side is None else str(side) for side in shape]
    return f"({', '.join(sides)}{',' if len(sides) == 1 else ''})"


def _finite(values: npt.NDArray[Any], name: str, nan: bool, inf: bool) -> None:
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


def poses(value: Any, name: str, count: int) -> None:
    """Wrong unless there are so many poses (count, 4, 4), all rigid motions."""
    T = array(value, name, (count, 4, 4), "number")
    R = T[:, :3, :3]
    off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2), initial=0) > RIGID
    off |= np.linalg.det(R) < 0
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
    if not len(C):
        return
    scale = np.maximum(np.abs(C).max(axis=(1, 2)), 1e-300)
    skew = np.abs(C - C.transpose(0, 2, 1)).max(axis=(1, 2)) / scale > RIGID
    off = skew | (np.diagonal(C, axis1=1, axis2=2) < 0).any(axis=1)
    if definite:
        off |= np.linalg.eigvalsh(C)[:, 0] <= 0
    if off.any():
        first = int(np.flatnonzero(off)[0])
        wanted = "symmetric and positive definite" if definite else "symmetric, with variances from 0"
        raise Wrong(f"{name} that are no covariances, the first is number {first}; they are {wanted}", first)


def number(value: Any, name: str, nan: bool = False) -> None:
    """Wrong unless a value is one finite number; `nan`: or NaN."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise Wrong(f"{name} as {named(value)}, not as a number")
    if not (np.isfinite(value) or (nan and np.isnan(value))):
        raise Wrong(f"{name} {value}, not a finite number")


def whole(value: Any, name: str) -> None:
    """Wrong unless a value is a whole number from 0."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise Wrong(f"{name} as {named(value)}, not as a whole number")
    if value < 0:
        raise Wrong(f"{name} {value}, below 0")


def sentences(value: Any, name: str) -> None:
    """Wrong unless a value is a sequence of texts."""
    if isinstance(value, str) or not isinstance(value, Sequence) or not all(isinstance(text, str) for text in value):
        raise Wrong(f"{name} as {named(value)}, not as a sequence of texts")
