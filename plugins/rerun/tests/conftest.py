"""Recordings made and read back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader

from omnilab.api import Record, Tick
from omnilab_rerun import RerunSink

Entry = tuple[str, Record, Tick | None]


class RecordedEntities:
    """What a recording holds, by entity and component."""

    def __init__(self, file: Path) -> None:
        self.reader = RrdReader(file)
        self.chunks = list(self.reader.stream().to_chunks())

    def rows(self, entity: str, column: str) -> list[Any]:
        """The column's values in order of time; components as they are, times as numbers."""
        found: list[tuple[int, Any]] = []
        for chunk in self.chunks:
            batch = chunk.to_record_batch()
            if chunk.entity_path != entity or column not in batch.schema.names:
                continue
            steps = batch.column("step").to_pylist() if "step" in batch.schema.names else [0] * batch.num_rows
            values = batch.column(column)
            values = values.cast("int64") if column in {"step", "sensor_time", "log_time"} else values
            found += zip(steps, values.to_pylist(), strict=True)
        return [value for _, value in sorted(found, key=lambda row: row[0]) if value is not None]

    def is_static(self, entity: str) -> bool:
        static = {chunk.is_static for chunk in self.chunks if chunk.entity_path == entity}
        assert len(static) == 1, f"{entity}: {static}"
        return static.pop()

    def blueprint(self) -> list[tuple[str, dict[str, Any]]]:
        """Entity and components of every chunk of the recording's last blueprint."""
        store = self.reader.blueprints()[-1]
        chunks = self.reader.stream(store=store).to_chunks()
        return [(chunk.entity_path, chunk.to_record_batch().to_pydict()) for chunk in chunks]


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.fixture
def recorded(tmp_path: Path) -> Callable[[Sequence[Entry]], RecordedEntities]:
    def record(entries: Sequence[Entry]) -> RecordedEntities:
        sink = RerunSink()
        sink.open(tmp_path)
        for path, what, tick in entries:
            sink.write(path, what, tick)
        sink.close()
        return RecordedEntities(tmp_path / "run.rrd")

    return record


@pytest.fixture
def read() -> Callable[[Path], RecordedEntities]:
    return RecordedEntities
