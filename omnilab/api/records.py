"""Records: what a run hands to its logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from omnilab.api.data import Bytes, Floats, Ints


@dataclass(frozen=True)
class Tick:
    """When a record belongs: the study's step and the sensor's time. The run's own clock is the sink's business."""

    step: int
    stamp_ns: int


@dataclass(frozen=True)
class Image:
    """A picture. The recorder fills in `encoded` once for all sinks."""

    pixels: Bytes  # (H, W) or (H, W, 3)
    format: str = "jpeg"  # or "png", lossless
    encoded: bytes = b""


@dataclass(frozen=True)
class Signature:
    """A described image laid out as a matrix (rows, columns), float32."""

    values: Floats


@dataclass(frozen=True)
class PlaceMap:
    """The places of a map: positions (P, 3) and headings (P,)."""

    position_m: Floats
    heading_rad: Floats | None = None


@dataclass(frozen=True)
class DistanceField:
    """The distance of one query to every place: positions (P, 3), values (P,)."""

    position_m: Floats
    values: Floats


@dataclass(frozen=True)
class Estimate:
    """One query: where it was taken and what was answered, positions (3,), headings in radians."""

    truth_m: Floats
    answer_m: Floats
    verdict: str  # "nearest", "second" or "wrong"
    truth_heading_rad: float = 0.0
    answer_heading_rad: float | None = None


@dataclass(frozen=True)
class Answers:
    """All queries of a study at a glance: truth (Q, 3), answer (Q, 3), verdicts (Q,)."""

    truth_m: Floats
    answer_m: Floats
    verdict: Sequence[str]


@dataclass(frozen=True)
class Pose:
    """Where the camera is: `T_world_camera` (4, 4)."""

    T_world_camera: Floats


@dataclass(frozen=True)
class Mesh:
    """The world's surface: vertices (V, 3) in metres, triangles (T, 3), one RGB colour per vertex (V, 3) uint8."""

    vertices_m: Floats
    triangles: Ints
    colors: Bytes
    one_sided: bool = False  # seen only from where the corners of a triangle run counter-clockwise


@dataclass(frozen=True)
class PointCloud:
    """Points (P, 3) of the world, in metres, each in its RGB colour (P, 3) uint8."""

    points_m: Floats
    colors: Bytes


@dataclass(frozen=True)
class Graph:
    """Points (N, 3) and edges (E, 2) between them, each edge in its RGB colour (E, 3) uint8."""

    position_m: Floats
    edges: Ints
    colors: Bytes | None = None  # None: all alike


@dataclass(frozen=True)
class Series:
    """A stretch of one curve: values (n,) at the study's steps (n,) and the sensor's times (n,)."""

    values: Floats
    steps: Ints
    stamps_ns: Ints
    unit: str
    color: tuple[int, int, int] | None = None  # RGB; None: the viewer chooses


@dataclass(frozen=True)
class Text:
    """A line of the run's log, or a document in Markdown."""

    text: str
    level: str = "INFO"  # INFO, NOTE (as INFO, but on the terminal, too), WARN, ERROR
    markdown: bool = False


@dataclass(frozen=True)
class Progress:
    """How far a stage has come: `done` of `total` items (0: not known)."""

    stage: str
    done: int
    total: int


@dataclass(frozen=True)
class Panel:
    """One view of a layout. `kind`: map (3-D), image, plot, text or log; `contents`: paths of the records it shows."""

    kind: str
    title: str
    contents: Sequence[str]


@dataclass(frozen=True)
class ViewLayout:
    """How a run should look in a viewer: columns of panels, from left to right, each from top to bottom."""

    columns: Sequence[Sequence[Panel]]
    widths: Sequence[float] = ()


Record = (
    Image
    | Signature
    | PlaceMap
    | DistanceField
    | Estimate
    | Answers
    | Pose
    | Mesh
    | PointCloud
    | Graph
    | Series
    | Text
    | Progress
    | ViewLayout
)
