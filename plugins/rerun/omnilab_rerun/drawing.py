"""Each record as Rerun archetypes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np
import rerun as rr

from omnilab.api import (
    Answers,
    DistanceField,
    Estimate,
    Floats,
    Graph,
    Image,
    Ints,
    Mesh,
    PlaceMap,
    PointCloud,
    Pose,
    Record,
    Signature,
    Text,
)
from omnilab.image import encode
from omnilab_rerun.colors import PLACE, TRUTH, VERDICT, Color, heat
from omnilab_rerun.records_seen import spacing_m, surface_height_m

Drawing = Iterator[tuple[str, list[rr.AsComponents]]]  # what to append to the record's path, archetypes


def draw(record: Record, spacing_m: float) -> Drawing:
    """The parts that a record is drawn with. Points and arrows are sized by the spacing of the map's places."""
    match record:
        case Image():
            contents = record.encoded or encode(record.pixels, record.format)
            yield "", [rr.EncodedImage(contents=contents, media_type=f"image/{record.format}")]
        case Signature():
            yield "", [rr.DepthImage(np.asarray(record.values, np.float32), colormap="viridis")]
        case PlaceMap():
            yield "", _places(record, spacing_m)
        case DistanceField():
            yield from _field(record)
        case Estimate():
            yield "", _estimate(record, spacing_m)
        case Answers():
            yield "", _answers(record, spacing_m)
        case Pose():
            yield "", _pose(record, spacing_m)
        case Mesh():
            yield "", [_mesh(record)]
        case PointCloud():
            yield "", [rr.Points3D(record.points_m, colors=record.colors, radii=rr.Radius.ui_points(1.5))]
        case Graph():
            yield "", _graph(record)
        case Text(markdown=True):
            yield "", [rr.TextDocument(record.text, media_type="text/markdown")]
        case Text():
            yield "", [rr.TextLog(record.text, level=record.level.replace("NOTE", "INFO"))]
        case _:
            raise TypeError(f"{type(record).__name__} has no drawing")


def _places(places: PlaceMap, spacing_m: float) -> list[rr.AsComponents]:
    dots = rr.Points3D(places.position_m, radii=0.1 * spacing_m, colors=PLACE)
    if places.heading_rad is None:
        return [dots]
    return [dots, _arrows(places.position_m, places.heading_rad, 0.4 * spacing_m, PLACE)]


def _arrows(origins_m: Floats, heading_rad: Floats, length_m: float, colors: Color | Sequence[Color]) -> rr.Arrows3D:
    heading = np.asarray(heading_rad, float)
    directions = np.stack([np.cos(heading), np.sin(heading), np.zeros_like(heading)], -1)
    return rr.Arrows3D(vectors=length_m * directions, origins=origins_m, radii=0.06 * length_m, colors=colors)


def _field(field: DistanceField) -> Drawing:
    """Coloured dots in the plan, and the surface over it whose height is the distance; bright is alike.

    Places without a finite distance were not compared and are left out.
    """
    compared = np.isfinite(field.values)
    if not compared.any():
        yield "", [rr.Clear(recursive=True)]
        return
    position = np.asarray(field.position_m, np.float32)[compared]
    values = np.asarray(field.values, np.float32)[compared]
    share = (values - values.min()) / max(np.ptp(values), np.finfo(np.float32).tiny)
    colors = heat(1 - share)
    dots = rr.Points3D(position, radii=0.32 * spacing_m(position), colors=colors)
    yield "", [dots, rr.AnyValues(distance=values)]
    if len(triangles := _triangles(position[:, :2].tobytes())):
        height = surface_height_m(np.ptp(position, axis=0))
        surface = position + np.outer(share, [0, 0, height]).astype(np.float32)
        yield "/surface", [rr.Mesh3D(vertex_positions=surface, triangle_indices=triangles, vertex_colors=colors)]


@lru_cache(maxsize=2)
def _triangles(xy: bytes) -> Ints:
    """Delaunay triangles (T, 3) of positions (P, 2) float32; none if these lie on a line."""
    from scipy.spatial import Delaunay, QhullError

    try:
        return np.asarray(Delaunay(np.frombuffer(xy, np.float32).reshape(-1, 2)).simplices)
    except QhullError:
        return np.zeros((0, 3), np.int32)


def _estimate(estimate: Estimate, spacing_m: float) -> list[rr.AsComponents]:
    """Truth and answer with their headings, and a line between them unless the answer is the nearest place."""
    ends = np.stack([estimate.truth_m, estimate.answer_m])
    heading = [h for h in (estimate.truth_heading_rad, estimate.answer_heading_rad) if h is not None]
    colors = [TRUTH, VERDICT[estimate.verdict]]
    return [
        rr.Points3D(ends, radii=0.6 * spacing_m, colors=colors),
        _arrows(ends[: len(heading)], np.array(heading), 4 * spacing_m, colors[: len(heading)]),
        _lines(ends[None], [estimate.verdict], 0.2 * spacing_m),
    ]


def _answers(answers: Answers, spacing_m: float) -> list[rr.AsComponents]:
    """Every query where it was taken, coloured by verdict, and lines from there to the answers that are not nearest."""
    colors = [VERDICT[verdict] for verdict in answers.verdict]
    ends = np.stack([answers.truth_m, answers.answer_m], 1)
    return [
        rr.Points3D(answers.truth_m, radii=0.12 * spacing_m, colors=colors),
        _lines(ends, answers.verdict, 0.06 * spacing_m),
    ]


def _lines(ends_m: Floats, verdicts: Sequence[str], radius_m: float) -> rr.LineStrips3D:
    shown = np.asarray(verdicts) != "nearest"
    colors = [VERDICT[verdict] for verdict in np.asarray(verdicts)[shown]]
    return rr.LineStrips3D(ends_m[shown], radii=radius_m, colors=colors)


def _graph(graph: Graph) -> list[rr.AsComponents]:
    """Edges as thin as can be seen from any distance; points in the colour of an edge that they have."""
    edges = np.tile(np.array(PLACE, np.uint8), (len(graph.edges), 1)) if graph.colors is None else graph.colors
    points = np.tile(np.array(PLACE, np.uint8), (len(graph.position_m), 1))
    points[graph.edges] = edges[:, None]
    return [
        rr.Points3D(graph.position_m, radii=rr.Radius.ui_points(1.5), colors=points),
        rr.LineStrips3D(graph.position_m[graph.edges], radii=rr.Radius.ui_points(0.8), colors=edges),
    ]


def _pose(pose: Pose, spacing_m: float) -> list[rr.AsComponents]:
    T = pose.T_world_camera
    return [
        rr.Transform3D(translation=T[:3, 3], mat3x3=T[:3, :3]),
        rr.TransformAxes3D(axis_length=2 * spacing_m),
    ]


def _mesh(mesh: Mesh) -> rr.Mesh3D:
    """A wall that is seen from its front alone hides no room from who looks in from outside."""
    sides = rr.components.MeshFaceRendering.Front if mesh.one_sided else rr.components.MeshFaceRendering.DoubleSided
    return rr.Mesh3D(
        vertex_positions=mesh.vertices_m,
        triangle_indices=mesh.triangles,
        vertex_colors=mesh.colors,
        face_rendering=sides,
    )
