"""What of a run's records decides how they are shown: where they are in the world, how large their curves become."""

from __future__ import annotations

from bisect import insort
from collections.abc import Sequence

import numpy as np

from omnilab.api import Answers, DistanceField, Floats, Graph, Mesh, PlaceMap, PointCloud, Pose, Record, Series

LONE_M = 0.2  # spacing of a map with a single place
FAR_M = 1e9  # where nothing is that could be shown
MOST = 100_000  # values of a curve of times
TIMES = ("ms", "s")  # units of curves of which a few values, such as a first slow image, may leave the plot
RARE, LEAST_RARE = 0.02, 2  # the largest values that may: a share of a curve, and how many at least
FLATTENED = 2.0  # how much higher they must be than all others


class RecordsSeen:
    """What was logged so far. Paths are compared without slashes at their ends."""

    def __init__(self) -> None:
        self.spacing_m = LONE_M  # of the map's places
        self._paths = set[str]()
        self._still: dict[str, Floats] = {}  # corners (2, 3) by path, of the first record
        self._moving: dict[str, Floats] = {}  # of the last one; of poses, of all
        self._surfaces = set[str]()  # paths of fields, which are drawn as surfaces where they are alone
        self._times: dict[str, TimesSeen] = {}

    def add(self, path: str, record: Record, still: bool) -> bool:
        """Remember what is of interest in a record; whether it changes from where maps are seen."""
        path = path.strip("/")
        self._paths.add(path)
        if isinstance(record, PlaceMap) and len(record.position_m):
            # markers as large as the spacing of a coarse map would hide it, those of a very fine one would be too small
            extent = float(np.ptp(record.position_m, axis=0).max()) or 25 * LONE_M
            self.spacing_m = float(np.clip(spacing_m(record.position_m), extent / 150, extent / 25))
        if isinstance(record, Series):
            if record.unit in TIMES:
                self._times.setdefault(path, TimesSeen()).add(record.values)
        elif (corners := corners_of(record)) is not None:
            if isinstance(record, DistanceField):
                self._surfaces.add(path)
            if still:
                new = path not in self._still
                self._still.setdefault(path, corners)
                return new
            if isinstance(record, Pose) and path in self._moving:
                corners = np.concatenate([corners, self._moving[path]])
                self._moving[path] = np.stack([corners.min(0), corners.max(0)])
            else:
                self._moving[path] = corners
        return False

    def holds(self, paths: Sequence[str]) -> bool:
        """Whether anything was logged at one of these paths, or below."""
        inside = [path.strip("/") for path in paths]
        return any(path == p or path.startswith(f"{p}/") for path in self._paths for p in inside)

    def corners(self, paths: Sequence[str]) -> Floats | None:
        """Corners (2, 3) of all that a map of these paths shows; None if nothing is known.

        What moves may lie outside of what lies still by half of that's size: what has gone astray makes no map small.
        """
        inside = [path.strip("/") for path in paths]
        if self.is_surface(inside) and inside[0] in self._moving:
            low, high = self._moving[inside[0]]
            return np.stack([low, high + np.array([0, 0, surface_height_m(high - low)])])
        still, moving = ([known[p] for p in inside if p in known] for known in (self._still, self._moving))
        if not still + moving:
            return None
        low, high = (corners := np.array(still or moving))[:, 0].min(0), corners[:, 1].max(0)
        if still and moving:
            margin = (high - low).max() / 2
            within = np.clip(np.array(moving), low - margin, high + margin)
            low, high = np.minimum(low, within[:, 0].min(0)), np.maximum(high, within[:, 1].max(0))
        return np.stack([low, high])

    def is_surface(self, paths: Sequence[str]) -> bool:
        """Whether a map of these paths shows the surface of a field."""
        return len(paths) == 1 and paths[0].strip("/") in self._surfaces

    def top(self, path: str) -> tuple[float, float] | None:
        """Of the curves of times at a path or below: where a plot of them should end, and their largest value.

        None if nothing should leave the plot.
        """
        path = path.strip("/")
        curves = [times for p, times in self._times.items() if p == path or p.startswith(f"{path}/")]
        largest = max((times.largest for times in curves), default=0.0)
        usual = max((times.usual for times in curves), default=0.0)
        return (1.1 * usual, largest) if largest > FLATTENED * usual > 0 else None


class TimesSeen:
    """The values of a curve of times, of which the largest are asked for after each one."""

    def __init__(self) -> None:
        self._count = 0
        self._sorted: list[float] = []  # those that are finite

    def add(self, values: Floats) -> None:
        """More values (n,), of which MOST in all are kept."""
        new = values[: MOST - self._count]
        self._count += len(new)
        finite = new[np.isfinite(new)].tolist()
        if len(finite) == 1:
            insort(self._sorted, finite[0])
        else:
            self._sorted = sorted(self._sorted + finite)

    @property
    def largest(self) -> float:
        return self._sorted[-1] if self._sorted else 0.0

    @property
    def usual(self) -> float:
        """The largest value without the few that are rare."""
        rare = max(LEAST_RARE, int(RARE * len(self._sorted)))
        return self._sorted[-rare - 1] if len(self._sorted) > 4 * rare else self.largest


def corners_of(record: Record) -> Floats | None:
    """Corners (2, 3) of where a record is in the world; None of most."""
    match record:
        case Mesh():
            points = record.vertices_m
        case PointCloud():
            points = record.points_m
        case PlaceMap() | Graph():
            points = record.position_m
        case DistanceField():
            margin = 0.5 * spacing_m(record.position_m)  # dots are large
            points = np.concatenate([record.position_m - margin, record.position_m + margin])
        case Answers():
            points = record.truth_m
        case Pose():
            points = record.T_world_camera[None, :3, 3]
        case _:
            return None
    finite = np.asarray(points, float)
    finite = finite[(np.abs(finite) < FAR_M).all(axis=-1)]
    return np.stack([finite.min(0), finite.max(0)]) if len(finite) else None


def surface_height_m(size_m: Floats) -> float:
    """How high the surface of a field over an area (2+,) is, in metres."""
    return float(0.3 * size_m[:2].max())


def spacing_m(position_m: Floats) -> float:
    """How far apart positions (P, 3) are on average, as if they were spread evenly over the plan."""
    extent = np.ptp(position_m[:, :2], axis=0) if len(position_m) else np.zeros(2)
    if not extent.any():
        return LONE_M
    if extent.min() == 0:
        return float(extent.max() / (len(position_m) - 1))
    return float(np.sqrt(extent.prod() / len(position_m)))
