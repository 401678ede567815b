"""What a record has under a name: a field, a metric, a component or a setting, by its full name or its last word."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any

from omnilab.client import RunRecord

FIELDS = ("started", "seconds", "state", "experiment", "host", "path", "sweep", "error")


def values(record: RunRecord, name: str) -> Sequence[Any]:
    """All that a record has under a name, the nearest first; nothing where it has no such thing."""
    if name in FIELDS:
        value = getattr(record, name)
        return () if value in (None, "") else (value,)
    if name in record.metrics:
        value = record.metrics[name]
        return () if value is None else (value,)
    slots = [record.components[slot] for slot in _full(record.components, name)]
    own = [name] if name in record.settings else _full(record.settings, name)
    return [*slots, *(record.settings[setting] for setting in own)]


def _full(content: Mapping[str, Any], name: str) -> Sequence[str]:
    """The full names in a mapping that are, or end in, a name."""
    return _by_last_word(tuple(content)).get(name, ())


@lru_cache(maxsize=1000)
def _by_last_word(names: tuple[str, ...]) -> dict[str, list[str]]:
    """Full names by themselves and by their last words: most records have the same."""
    found: dict[str, list[str]] = {}
    for name in names:
        for short in {name, name.rpartition(".")[2]}:
            found.setdefault(short, []).append(name)
    return found


def in_order(records: Iterable[RunRecord], sort: str) -> list[RunRecord]:
    """Records by what they have under a name, a `-` before which turns the order round; those that have nothing are last."""
    name = sort.removeprefix("-")
    there, missing = [], []
    for record in records:
        found = values(record, name)
        if found and found[0] is not None:
            there.append((_key(found[0]), record))
        else:
            missing.append(record)
    there.sort(key=lambda pair: pair[0], reverse=sort.startswith("-"))
    return [*(record for _, record in there), *missing]


def _key(value: Any) -> tuple[int, int | float, str]:
    """Numbers by size, then texts."""
    if isinstance(value, int | float):
        return 0, value, ""
    return 1, 0.0, str(value).casefold()
