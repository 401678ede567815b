"""What a recording holds, and how its study wants it shown, read back from the recording itself."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from rerun.chunk import RrdReader, StoreEntry

from omnilab.api import Floats, Panel
from omnilab.errors import DataError
from omnilab_rerun.blueprint import absolute

KINDS = {"3D": "map", "2D": "image", "TimeSeries": "plot", "TextDocument": "text", "TextLog": "log"}  # of views
PICTURED = ("map", "image", "plot")
POSITIONS = ("Points3D:positions", "Mesh3D:vertex_positions", "LineStrips3D:strips")
MOST_PANELS = 100


@dataclass(frozen=True)
class RecordingContents:
    """Panels in the layout's order, the corners (2, 3) of what lies still by its entity, and the curves with their units."""

    panels: list[Panel]  # none of a run that was killed before its first step, or whose study has no layout
    extents: dict[str, Floats]
    curves: dict[str, str]  # unit by entity

    @property
    def maps(self) -> list[Panel]:
        return [panel for panel in self.panels if panel.kind == "map"]

    @property
    def plots(self) -> list[Panel]:
        """Those with a curve."""
        return [panel for panel in self.panels if panel.kind == "plot" and self.shown(panel)]

    def simple_panels(self) -> list[Panel]:
        """Panels for want of a layout: all that lies still in one map, each curve for itself."""
        maps = [Panel("map", "Map", list(self.extents))] if self.extents else []
        return maps + [Panel("plot", path.strip("/"), [path]) for path in self.curves]

    def shown(self, panel: Panel) -> list[str]:
        """The curves that a plot shows."""
        paths = [absolute(path) for path in panel.contents]
        return [curve for curve in self.curves if any(curve == path or curve.startswith(f"{path}/") for path in paths)]


def contents_of(recording: Path) -> RecordingContents:
    """What is in a whole recording; DataError if it cannot be read back. One chunk at a time is in memory."""
    try:
        reader = RrdReader(recording)
        extents, curves = dict[str, Floats](), dict[str, str]()
        for chunk in reader.stream().filter(is_static=True):
            batch = chunk.to_record_batch()
            if "SeriesLines:names" in batch.schema.names:
                unit = re.search(r"\[(.*)\]$", batch.column("SeriesLines:names").to_pylist()[-1][0])
                curves[chunk.entity_path] = unit[1] if unit else ""
            points = [_points(batch.column(name)) for name in POSITIONS if name in batch.schema.names]
            if points and len(found := np.concatenate(points)):
                extents[chunk.entity_path] = np.stack([found.min(0), found.max(0)])
        stores = reader.blueprints()
        panels = list(_panels(reader, stores[-1])) if stores else []
        if not any(panel.kind in PICTURED for panel in panels):  # the runner's, not the study's
            panels = []
    except (RuntimeError, ValueError) as error:
        raise DataError(f"{recording} cannot be read back; mend it: omnilab repair {recording.parent}") from error
    return RecordingContents(panels, extents, curves)


def _points(column: pa.Array) -> Floats:
    """Points (n, 3) of lists of them, or of lists of strips."""
    while pa.types.is_nested(column.type):
        column = column.flatten()
    return np.asarray(column, float).reshape(-1, 3)


def _panels(reader: RrdReader, store: StoreEntry) -> Iterator[Panel]:
    """The panels of a layout of ours, column by column."""
    parts: dict[str, dict[str, Any]] = {}
    for chunk in reader.stream(store=store):
        values = chunk.to_record_batch().to_pydict()
        parts.setdefault(chunk.entity_path, {}).update({name: rows[-1] for name, rows in values.items() if rows})
    inside = {path: [absolute(p) for p in part.get("ContainerBlueprint:contents", [])] for path, part in parts.items()}
    children = {path for paths in inside.values() for path in paths}
    waiting = sorted(path for path in inside if path.startswith("/container/") and path not in children)
    for _ in range(MOST_PANELS):
        if not waiting:
            return
        path = waiting.pop(0)
        waiting = inside.get(path, []) + waiting
        part = parts.get(path, {})
        if (kind := KINDS.get(part.get("ViewBlueprint:class_identifier", [""])[0])) is not None:
            query = parts.get(f"{path}/ViewContents", {}).get("ViewContents:query", [])
            paths = [rule[2:].removesuffix("/**") for rule in query if rule.startswith("+ ")]
            yield Panel(kind, part.get("ViewBlueprint:display_name", [""])[0], paths)
