"""Classes of which a configuration can surely be made, without making one: that would take half of the time of a start."""

from __future__ import annotations

from dataclasses import MISSING, Field, fields, is_dataclass
from enum import Enum
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

PLAIN = (bool, int, float, str)


def are_plain(cls: type[Any]) -> bool:
    """Whether every field of a dataclass is of a type that a setting can have, and its default of that type.

    False of what is not looked at here: OmegaConf has the last word on that.
    """
    if issubclass(cls, dict | list):
        return False
    hints = get_type_hints(cls)
    return all(_is_plain(hints[each.name], _default(each)) for each in fields(cls))


def _default(each: Field[Any]) -> Any:
    return each.default if each.default_factory is MISSING else each.default_factory()


def _is_plain(hint: Any, value: Any) -> bool:
    if get_origin(hint) in {Union, UnionType}:
        return _is_optional(hint, value)
    if isinstance(value, str) and "${" in value:
        return False  # which OmegaConf reads
    if hint in PLAIN:
        given = type(value)
        return value is MISSING or given is hint or (given is str and value == "???") or (given, hint) == (int, float)
    if hint is Any:
        return _is_plain_value(value)
    if isinstance(hint, type) and issubclass(hint, Enum):
        return value is MISSING or type(value) is hint
    if isinstance(hint, type) and is_dataclass(hint):
        return value is MISSING or (type(value) is hint and _holds_plain(hint, value))
    return _is_container(hint, value)


def _is_plain_value(value: Any) -> bool:
    """Of a setting that may be anything."""
    if type(value) is list:
        return all(map(_is_plain_value, value))
    return value is MISSING or value is None or (type(value) in PLAIN and "${" not in str(value))


def _is_optional(hint: Any, value: Any) -> bool:
    members = [each for each in get_args(hint) if each is not NoneType]
    return len(members) == 1 and _is_plain(members[0], MISSING if value is None else value)


def _holds_plain(cls: type[Any], value: Any) -> bool:
    """Of a setting that has its own."""
    return are_plain(cls) and all(_is_plain(hint, getattr(value, name)) for name, hint in get_type_hints(cls).items())


def _is_container(hint: Any, value: Any) -> bool:
    """Of a list, or of a dictionary by names."""
    origin, members = get_origin(hint), get_args(hint)
    if origin is list:
        held = [] if value is MISSING else value
        return type(held) is list and all(_is_plain(members[0], each) for each in [MISSING, *held])
    if origin is dict:
        held = {} if value is MISSING else value
        return members[0] is str and type(held) is dict and all(
            type(name) is str and _is_plain(members[1], each) for name, each in [("", MISSING), *held.items()]
        )  # fmt: skip
    return False
