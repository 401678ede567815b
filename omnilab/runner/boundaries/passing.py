"""What passes between a run and its components belongs to one side: inputs are read-only, results are the caller's own."""

from __future__ import annotations

import copy
import sys
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")
HOLDERS = (np.ndarray, list, tuple, dict)  # and the dataclasses of omnilab.api


def read_only(value: T) -> T:
    """The same value, into which nobody can write: arrays as read-only views, lists and dictionaries as copies.

    Also within lists, tuples, dictionaries and the dataclasses of `omnilab.api`; all else is handed on as it is.
    """
    return _read_only(value)  # type: ignore[no-any-return]


def _read_only(value: Any) -> Any:
    kind = type(value)
    if isinstance(value, np.ndarray):
        if not value.flags.writeable:
            return value
        view = value.view()
        view.flags.writeable = False
        return view
    if kind is list or kind is tuple:
        return kind([item if type(item) is str else _read_only(item) for item in value])
    if kind is dict:
        return {key: _read_only(item) for key, item in value.items()}
    return _changed(
        value, {name: _read_only(part) for name in _names(kind) if holds_arrays(part := getattr(value, name))}
    )


def unshared(fresh: list[Any]) -> Any:
    """The one value in a list, as the caller's own: what somebody else holds, or nobody can write into, is copied.

    A component that returned the same buffer each time would change its earlier results. What it made anew is handed on
    without a copy: the number of references tells, so that nothing but the list may hold the value.
    """
    return _unshared(fresh, False, ALONE)


def _unshared(last: list[Any], shared: bool, alone: int) -> Any:
    """The value in a list; `shared`: what it is part of is held elsewhere; `alone`: its references where it is not."""
    value = last.pop()
    shared = shared or sys.getrefcount(value) > alone
    kind = type(value)
    if kind is np.ndarray or kind is np.memmap:
        return np.array(value) if shared or not value.flags.writeable or _is_part([value.base]) else value
    if kind is list or kind is tuple:
        within = ALONE + 1  # the list holds it
        return kind(
            [value[i] if type(value[i]) is str else _unshared([value[i]], shared, within) for i in range(len(value))]
        )
    if kind is dict:
        return {key: _unshared([value[key]], shared, ALONE + 1) for key in value}
    parts = {
        name: _unshared([getattr(value, name)], shared, ALONE + 1)
        for name in _names(kind)
        if holds_arrays(getattr(value, name))
    }
    if not shared and all(part is getattr(value, name) for name, part in parts.items()):
        return value
    return _changed(value, parts)


def _is_part(last: list[Any]) -> bool:
    """Whether the memory of an array belongs to what others hold, or to no array."""
    base = last.pop()
    if base is None:
        return False
    return sys.getrefcount(base) > ALONE + 1 or type(base) is not np.ndarray or _is_part([base.base])


_NAMES: dict[type[Any], tuple[str, ...]] = {}


def _names(kind: type[Any]) -> tuple[str, ...]:
    """The fields of the dataclasses of `omnilab.api`, such as Signatures; none of other classes."""
    if kind not in _NAMES:
        ours = is_dataclass(kind) and any(base.__module__.startswith("omnilab.api.") for base in kind.__mro__)
        _NAMES[kind] = tuple(f.name for f in fields(kind)) if ours else ()
    return _NAMES[kind]


def _changed(value: Any, parts: dict[str, Any]) -> Any:
    """A copy of a dataclass with other values of some fields."""
    if not parts:
        return value
    kind = type(value)
    if kind.__module__.startswith("omnilab.api."):  # a plain one: as `copy` does, in a third of its time
        new = object.__new__(kind)
        vars(new).update(vars(value))
    else:
        new = copy.copy(value)
    for name, part in parts.items():
        object.__setattr__(new, name, part)
    return new


def holds_arrays(value: Any) -> bool:
    """Whether a value may hold arrays, as far as they are looked for here."""
    return isinstance(value, HOLDERS) or bool(_names(type(value)))


def _references(last: list[Any]) -> int:
    value = last.pop()
    return sys.getrefcount(value)


ALONE = _references([object()])  # of a value that one variable holds
