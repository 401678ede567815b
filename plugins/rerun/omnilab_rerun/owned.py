"""What Rerun's threads are given: copies in Arrow's own memory.

They write what is logged some tenths of a second later, and Arrow borrows NumPy's memory: the recording would show what a
study has written into its array since. They would also need Python's lock to give that memory back, which a library may
hold for minutes, and what was logged before would not reach the file meanwhile.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pyarrow as pa
import rerun as rr


class Owned:
    """A component's values, or a column of them, or of times."""

    def __init__(self, source: Any) -> None:
        self.component_descriptor = getattr(source, "component_descriptor", None)
        self.timeline_name = getattr(source, "timeline_name", None)
        array = source.as_arrow_array()
        self._array = array and array.copy_to(pa.default_cpu_memory_manager())

    def as_arrow_array(self) -> Any:
        return self._array


class OwnedRow(Owned):
    """A component's values as a column of a single row."""

    def as_arrow_array(self) -> Any:
        return pa.ListArray.from_arrays(pa.array([0, len(self._array)], pa.int32()), self._array)


def owned(batches: Iterable[Any]) -> list[Any]:
    """Components, columns or times, each with its values in memory of its own."""
    return [Owned(batch) for batch in batches]


def components(*archetypes: rr.AsComponents) -> list[Any]:
    """All components of some archetypes, owned."""
    return owned(batch for archetype in archetypes for batch in archetype.as_component_batches())


def row(*archetypes: rr.AsComponents) -> list[Any]:
    """All components of some archetypes as columns of a single row, owned."""
    batches = (batch for archetype in archetypes for batch in archetype.as_component_batches())
    return [OwnedRow(batch) for batch in batches]
