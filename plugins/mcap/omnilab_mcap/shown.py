"""What a layout must know of a topic: the schema of its messages, and what spans they hold."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from omnilab import api
from omnilab.api import Floats


@dataclass
class Shown:
    """A topic, as far as its records were seen."""

    schema: str
    corners_m: Floats | None = None  # (2, 3), of what lies in the world
    range: tuple[float, float] | None = None  # of a matrix of numbers, or of what lies at points
    colored: bool = False  # points with a colour each
    unit: str = ""  # of a curve
    color: tuple[int, int, int] | None = None  # of a curve
    _steps: Any = field(default_factory=hashlib.sha256)

    def see(self, record: api.Record) -> None:
        """Take note of one more record."""
        points = _points(record)
        if len(points := points[np.isfinite(points).all(1)]):
            ends = [points.min(0), points.max(0)]
            if self.corners_m is not None:
                ends = [np.minimum(ends[0], self.corners_m[0]), np.maximum(ends[1], self.corners_m[1])]
            self.corners_m = np.stack(ends)
        match record:
            case api.Signature() | api.DistanceField():
                self._span(record.values)
            case api.PointCloud():
                self.colored = True
            case api.Series():
                self.unit, self.color = record.unit, record.color
                self._steps.update(np.asarray(record.steps, np.int64).tobytes())

    @property
    def steps(self) -> str:
        """Of a curve: the same for the same steps."""
        return str(self._steps.hexdigest())

    def _span(self, values: Floats) -> None:
        if len(finite := values[np.isfinite(values)]):
            low, high = self.range or (np.inf, -np.inf)
            self.range = min(low, float(finite.min())), max(high, float(finite.max()))


def _points(record: api.Record) -> Floats:
    """Where in the world a record lies (P, 3)."""
    match record:
        case api.PlaceMap() | api.DistanceField() | api.Graph():
            return record.position_m
        case api.Estimate():
            return np.stack([record.truth_m, record.answer_m])
        case api.Answers():
            return np.concatenate([record.truth_m, record.answer_m])
        case api.Mesh():
            return record.vertices_m
        case api.PointCloud():
            return record.points_m
        case api.Pose():
            return record.T_world_camera[None, :3, 3]
    return np.empty((0, 3))
