"""Records that share what they have in common: ten thousand of them are held in memory."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any

from omnilab.client import RunRecord


def compact(record: RunRecord) -> RunRecord:
    """The same record, whose texts, units and components are those of others."""
    return replace(
        record,
        overrides=tuple(map(sys.intern, record.overrides)),
        components=_one(tuple(record.components.items())),
        units=_one(tuple(record.units.items())),
        settings=_named(record.settings),
        metrics=_named(record.metrics),
        intervals={sys.intern(name): tuple(pair) for name, pair in record.intervals.items()},
    )


def _named(values: Mapping[str, Any]) -> dict[str, Any]:
    return {sys.intern(name): sys.intern(value) if type(value) is str else value for name, value in values.items()}


@lru_cache(maxsize=1000)
def _one(items: tuple[tuple[str, str], ...]) -> Mapping[str, str]:
    return {sys.intern(name): sys.intern(value) for name, value in items}
