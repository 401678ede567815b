"""What type a setting has, by its name on the command line, and how that is said."""

from __future__ import annotations

import enum
import types
from collections.abc import Sequence
from dataclasses import is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints

from omnilab.api import KINDS
from omnilab.runner.config import Settings
from omnilab.runner.registry import DICTS, Registry

TEXTS = (str, Path)


def types_of(key: str, registry: Registry) -> list[Any]:
    """The types that a setting has in the components that may be chosen there; none if it is not known."""
    slot, *names = key.lstrip("+~").split(".")
    if slot in KINDS and names:
        found: list[Any] = [c.cls for c in registry.components.values() if c.kind == slot]
    elif slot in DICTS and len(names) > 1:
        found, names = [c.cls for c in registry.components.values() if c.kind == DICTS[slot]], names[1:]
    else:
        found, names = [Settings], [slot, *names]
    for name in names:
        found = [below for cls in found for below in _below(cls, name)]
    return found


def _below(cls: Any, name: str) -> list[Any]:
    for member in _members(cls):
        if _is_component(member):
            hints = _hints(member)
            return [hints[name]] if name in hints else []
        if get_origin(member) is dict:
            return [get_args(member)[1]]
    return []


def _is_component(cls: Any) -> bool:
    return is_dataclass(cls)


@cache
def _hints(cls: Any) -> dict[str, Any]:
    try:
        return get_type_hints(cls)
    except Exception:  # noqa: BLE001  names that only a type checker sees
        return {}


def _members(cls: Any) -> Sequence[Any]:
    """The types of a union but for None; of another type, itself."""
    if get_origin(cls) in {Union, types.UnionType}:
        return [member for member in get_args(cls) if member is not type(None)]
    return [cls]


def is_text(found: Sequence[Any]) -> bool:
    """Whether each of these types is a text or a path."""
    return bool(found) and all(member in TEXTS for cls in found for member in _members(cls))


def is_list_of_texts(found: Sequence[Any]) -> bool:
    """Whether each of these types is a list of texts or paths."""
    members = [member for cls in found for member in _members(cls)]
    return bool(members) and all(get_origin(m) is list and get_args(m)[0] in TEXTS for m in members)


def may_have_settings(found: Sequence[Any]) -> bool:
    """Whether any of these types has settings of its own: a dataclass, a dictionary, or what is not known."""
    members = [member for cls in found for member in _members(cls)]
    return any(m is Any or _is_component(m) or m is dict or get_origin(m) is dict for m in members)


def wanted(found: Sequence[Any], key: str) -> str:
    """What a setting takes, in words."""
    return " or ".join(dict.fromkeys(_words(cls, key) for cls in found)) or "a value such as 3, text or [1,2]"


def _words(cls: Any, key: str) -> str:
    words = [_word(member, key) for member in _members(cls)]
    if len(_members(cls)) < len(get_args(cls)) and get_origin(cls) in {Union, types.UnionType}:
        words.append("null")
    return " or ".join(words)


def _word(cls: Any, key: str) -> str:
    if isinstance(cls, type) and issubclass(cls, enum.Enum):
        return " or ".join(member.name for member in cls)
    if _is_component(cls):
        return f"its settings one by one, as in {key}.{next(iter(_hints(cls)), 'NAME')}=VALUE"
    if get_origin(cls) is list:
        example = {int: "[1,2]", float: "[1.0,2.0]", bool: "[true,false]"}.get(get_args(cls)[0], "[a,b]")
        return f"a list such as {'[[1.0,2.0],[3.0,4.0]]' if get_origin(get_args(cls)[0]) is list else example}"
    if get_origin(cls) is dict:
        return "values by name, such as {a:1,b:2}"
    return {bool: "true or false", int: "a whole number", float: "a number", str: "a text", Path: "a path"}.get(
        cls, "another value"
    )
