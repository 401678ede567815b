"""Records from JSON: what is there must be of its type, what is not known is left out."""

from __future__ import annotations

import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, fields, is_dataclass
from typing import Any, TypeVar

from omnilab.errors import DataError

T = TypeVar("T")
SCALARS = {str: "a text", int: "a whole number", float: "a number", bool: "true or false"}


def read(kind: type[T], data: object, place: str = "the answer") -> T:
    """The data as one of our records; DataError if it is none."""
    found: T = _read(kind, data, place)
    return found


def read_each(kind: type[T], data: object, place: str = "the answer") -> list[T]:
    """An array of data as records; DataError if it is none."""
    found: list[T] = _read(Sequence[kind], data, place)  # type: ignore[valid-type]
    return found


def _read(kind: Any, data: Any, place: str) -> Any:
    origin, parameters = typing.get_origin(kind), typing.get_args(kind)
    if kind is Any:
        return data
    if origin in {types.UnionType, typing.Union}:  # X | None
        (inner,) = [parameter for parameter in parameters if parameter is not types.NoneType]
        return None if data is None else _read(inner, data, place)
    if is_dataclass(kind):
        return _read_record(kind, _of_type(data, dict, "an object", place), place)
    if origin is Sequence:
        items = _of_type(data, list, "an array", place)
        return [_read(parameters[0], item, f"{place}[{i}]") for i, item in enumerate(items)]
    if origin in {Mapping, dict}:
        entries = _of_type(data, dict, "an object", place)
        return {name: _read(parameters[1], value, f"{place}.{name}") for name, value in entries.items()}
    if kind is float and type(data) is int:
        return float(data)
    return _of_type(data, kind, SCALARS[kind], place)


def _read_record(kind: Any, data: dict[str, Any], place: str) -> Any:
    hints = typing.get_type_hints(kind)
    missing = [field.name for field in fields(kind) if _is_needed(field) and field.name not in data]
    if missing:
        raise DataError(f"{place} has no '{missing[0]}', which every {kind.__name__} has; is it of `omnilab serve`?")
    known = [field.name for field in fields(kind) if field.name in data]
    return kind(**{name: _read(hints[name], data[name], f"{place}.{name}") for name in known})


def _is_needed(field: Field[Any]) -> bool:
    return field.default is MISSING and field.default_factory is MISSING


def _of_type(data: Any, kind: type[T], what: str, place: str) -> T:
    if type(data) is not kind:  # True is an int, too
        raise DataError(f"{place} is {str(data)[:80]!r}, which is not {what}; the server may be of another version")
    return data
