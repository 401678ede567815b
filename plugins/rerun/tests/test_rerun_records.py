"""Every kind of record is written and read back."""

from __future__ import annotations

import numpy as np
import pytest
import rerun as rr

from omnilab.api import (
    Answers,
    DistanceField,
    Estimate,
    Graph,
    Image,
    Mesh,
    PlaceMap,
    PointCloud,
    Pose,
    Progress,
    Series,
    Signature,
    Text,
    Tick,
)
from omnilab.geometry import planar_poses
from omnilab.image import encode
from omnilab_rerun.colors import TRUTH, VERDICT, heat
from omnilab_rerun.records_seen import spacing_m

AT = Tick(7, 1_234_567_891)
GRID = np.stack([*np.meshgrid(np.arange(4) * 0.5, np.arange(3) * 0.5), np.ones((3, 4))], -1).reshape(-1, 3)


def packed(color) -> int:
    red, green, blue = (int(c) for c in color)
    return red << 24 | green << 16 | blue << 8 | 255


@pytest.mark.parametrize("format", ["jpeg", "png"])
def test_image_keeps_the_bytes_that_the_recorder_encoded(recorded, rng, format):
    pixels = rng.integers(0, 255, (12, 16, 3), np.uint8)
    data = encode(pixels, format)
    log = recorded([("image", Image(pixels, format, data), AT), ("raw", Image(pixels, format), AT)])
    for entity in "/image", "/raw":
        assert bytes(log.rows(entity, "EncodedImage:blob")[0][0]) == data
        assert log.rows(entity, "EncodedImage:media_type") == [[f"image/{format}"]]


def test_signature_keeps_its_values(recorded, rng):
    values = rng.normal(size=(5, 9)).astype(np.float32)
    log = recorded([("a/signature", Signature(values), AT)])
    buffer = bytes(log.rows("/a/signature", "DepthImage:buffer")[0][0])
    np.testing.assert_array_equal(np.frombuffer(buffer, np.float32).reshape(5, 9), values)
    (format,) = log.rows("/a/signature", "DepthImage:format")[0]
    assert (format["width"], format["height"]) == (9, 5)


def test_places_with_headings(recorded):
    heading = np.linspace(0, np.pi, len(GRID))
    log = recorded([("/places", PlaceMap(GRID, heading), None)])
    np.testing.assert_allclose(log.rows("/places", "Points3D:positions")[0], GRID)
    arrows = np.array(log.rows("/places", "Arrows3D:vectors")[0])
    np.testing.assert_allclose(np.arctan2(arrows[:, 1], arrows[:, 0]), heading, atol=1e-6)


def test_distance_field_as_dots_and_as_a_surface(recorded):
    values = np.hypot(GRID[:, 0] - 0.5, GRID[:, 1]).astype(np.float32)
    log = recorded([("distance", DistanceField(GRID, values), AT)])
    np.testing.assert_array_equal(log.rows("/distance", "distance")[0], values)
    np.testing.assert_allclose(log.rows("/distance", "Points3D:positions")[0], GRID)
    assert log.rows("/distance", "Points3D:colors")[0][1] == packed(heat(np.ones(1))[0]), "the nearest is brightest"

    surface = np.array(log.rows("/distance/surface", "Mesh3D:vertex_positions")[0])
    np.testing.assert_allclose(surface[:, :2], GRID[:, :2])
    rise = surface[:, 2] - GRID[:, 2]
    np.testing.assert_allclose(rise / rise.max(), values / values.max(), atol=1e-6)
    corners = surface[np.array(log.rows("/distance/surface", "Mesh3D:triangle_indices")[0]), :2]
    (ax, ay), (bx, by) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    assert np.abs(ax * by - ay * bx).sum() / 2 == pytest.approx(1.5 * 1.0), "the triangles tile the map once"


@pytest.mark.parametrize(
    ("position", "values", "dots"),
    [(GRID[:4], np.arange(4.0), 4), (GRID[:1], np.ones(1), 1), (GRID[:5], np.array([1, np.nan, 2, np.inf, 3]), 3)],
    ids=["on a line", "one place", "some not compared"],
)
def test_distance_fields_without_a_surface(recorded, position, values, dots):
    log = recorded([("distance", DistanceField(position, values), AT)])
    assert len(log.rows("/distance", "Points3D:positions")[0]) == dots


def test_distance_field_of_a_query_that_was_compared_with_nothing_clears_the_last(recorded):
    fields = [DistanceField(GRID, np.ones(len(GRID))), DistanceField(GRID, np.full(len(GRID), np.nan))]
    log = recorded([("distance", field, Tick(step, step)) for step, field in enumerate(fields)])
    assert log.rows("/distance", "Clear:is_recursive") == [[True]]
    assert len(log.rows("/distance", "Points3D:positions")) == 1


@pytest.mark.parametrize("verdict", ["nearest", "second", "wrong"])
def test_estimate_is_coloured_by_its_verdict_and_joined_by_a_line_unless_nearest(recorded, verdict):
    truth, answer = np.array([1.0, 2, 3]), np.array([1.5, 2, 3])
    log = recorded([("estimate", Estimate(truth, answer, verdict, 0.5, -0.5), AT)])
    np.testing.assert_array_equal(log.rows("/estimate", "Points3D:positions")[0], [truth, answer])
    assert log.rows("/estimate", "Points3D:colors")[0] == [packed(TRUTH), packed(VERDICT[verdict])]
    arrows = np.array(log.rows("/estimate", "Arrows3D:vectors")[0])
    np.testing.assert_allclose(np.arctan2(arrows[:, 1], arrows[:, 0]), [0.5, -0.5], atol=1e-6)
    lines = log.rows("/estimate", "LineStrips3D:strips")[0]
    assert lines == ([] if verdict == "nearest" else [[[1, 2, 3], [1.5, 2, 3]]])


def test_estimate_without_an_answered_heading_has_one_arrow(recorded):
    log = recorded([("estimate", Estimate(np.zeros(3), np.ones(3), "wrong"), AT)])
    assert len(log.rows("/estimate", "Arrows3D:vectors")[0]) == 1


def test_answers_are_one_batch(recorded, rng):
    truth = rng.normal(size=(5, 3)).astype(np.float32)
    verdicts = ["nearest", "wrong", "second", "nearest", "wrong"]
    log = recorded([("answers", Answers(truth, truth + 1, verdicts), None)])
    np.testing.assert_array_equal(log.rows("/answers", "Points3D:positions")[0], truth)
    assert log.rows("/answers", "Points3D:colors")[0] == [packed(VERDICT[verdict]) for verdict in verdicts]
    lines = np.array(log.rows("/answers", "LineStrips3D:strips")[0])
    np.testing.assert_array_equal(lines, np.stack([truth, truth + 1], 1)[[1, 2, 4]])


def test_pose_is_the_transform_from_camera_to_world(recorded):
    T = planar_poses([[1, 2, 3]], [0.7])[0]
    log = recorded([("camera", Pose(T), AT)])
    np.testing.assert_allclose(log.rows("/camera", "Transform3D:translation")[0], [T[:3, 3]])
    columns = np.array(log.rows("/camera", "Transform3D:mat3x3")[0]).reshape(3, 3)
    np.testing.assert_allclose(columns.T, T[:3, :3], atol=1e-7)  # rerun stores column by column


def test_mesh(recorded):
    triangles, colors = np.array([[0, 1, 2], [2, 1, 3]]), np.uint8([[1, 2, 3]] * 4)
    log = recorded([("room", Mesh(GRID[:4], triangles, colors), None)])
    np.testing.assert_allclose(log.rows("/room", "Mesh3D:vertex_positions")[0], GRID[:4])
    np.testing.assert_array_equal(log.rows("/room", "Mesh3D:triangle_indices")[0], triangles)
    assert log.rows("/room", "Mesh3D:vertex_colors")[0] == [packed((1, 2, 3))] * 4
    assert log.rows("/room", "Mesh3D:face_rendering") == [[rr.components.MeshFaceRendering.DoubleSided.value]]


def test_walls_that_are_seen_from_inside_alone(recorded):
    walls = Mesh(GRID[:3], np.array([[0, 1, 2]]), np.zeros((3, 3), np.uint8), one_sided=True)
    log = recorded([("room", walls, None)])
    assert log.rows("/room", "Mesh3D:face_rendering") == [[rr.components.MeshFaceRendering.Front.value]]


def test_point_cloud(recorded):
    colors = np.uint8([[1, 2, 3], [4, 5, 6], [7, 8, 9], [10, 11, 12]])
    log = recorded([("cloud", PointCloud(GRID[:4], colors), AT)])
    np.testing.assert_allclose(log.rows("/cloud", "Points3D:positions")[0], GRID[:4])
    assert log.rows("/cloud", "Points3D:colors")[0] == [packed(color) for color in colors.tolist()]


def test_series_in_stretches_is_one_curve(recorded):
    steps = np.arange(10)
    entries = [
        ("error/m", Series(half / 4, half, half * 10**8, "m"), None) for half in (steps[:6], steps[6:])
    ]  # fmt: skip
    log = recorded(entries)
    assert log.rows("/error/m", "step") == list(steps)
    assert log.rows("/error/m", "sensor_time") == list(steps * 10**8)
    assert log.rows("/error/m", "Scalars:scalars") == [[step / 4] for step in steps]
    assert log.rows("/error/m", "SeriesLines:names") == [["m [m]"]]


def test_a_curve_may_have_a_color(recorded):
    log = recorded([("error/m", Series(np.zeros(3), np.arange(3), np.arange(3), "m", (42, 157, 92)), None)])
    assert log.rows("/error/m", "SeriesLines:colors") == [[packed((42, 157, 92))]]


def test_a_graph_s_points_have_the_color_of_their_edges(recorded):
    red, green = (200, 0, 0), (0, 200, 0)
    graph = Graph(GRID[:4].astype(float), np.array([[0, 1], [2, 3]]), np.uint8([red, green]))
    log = recorded([("graph", graph, AT)])
    np.testing.assert_allclose(log.rows("/graph", "LineStrips3D:strips")[0], GRID[:4].reshape(2, 2, 3))
    assert log.rows("/graph", "LineStrips3D:colors")[0] == [packed(red), packed(green)]
    assert log.rows("/graph", "Points3D:colors")[0] == [packed(color) for color in (red, red, green, green)]


def test_log_lines_without_a_tick_stay_apart_and_lie_where_the_run_is(recorded):
    log = recorded([("log", Text("start"), None), ("log", Text("later", "WARN"), AT), ("log", Text("then"), None)])
    assert log.rows("/log", "TextLog:text") == [["start"], ["later"], ["then"]]
    assert log.rows("/log", "TextLog:level") == [["INFO"], ["WARN"], ["INFO"]]
    assert log.rows("/log", "step") == [0, 7, 7]


def test_markdown(recorded):
    log = recorded([("notes", Text("# Title", markdown=True), None)])
    assert log.rows("/notes", "TextDocument:text") == [["# Title"]]
    assert log.rows("/notes", "TextDocument:media_type") == [["text/markdown"]]
    assert log.is_static("/notes")


def test_ticks_become_both_timelines_and_no_tick_is_static(recorded):
    log = recorded([("a", Signature(np.ones((2, 2))), AT), ("b", Signature(np.ones((2, 2))), None)])
    assert not log.is_static("/a")
    assert log.is_static("/b")
    assert log.rows("/a", "step") == [AT.step]
    assert log.rows("/a", "sensor_time") == [AT.stamp_ns]


def test_progress_is_skipped(recorded):
    log = recorded([("progress", Progress("describe", 1, 2), None)])
    assert {chunk.entity_path for chunk in log.chunks} == {"/__properties", "/__properties/run"}


def test_a_record_of_an_unknown_kind_is_refused(recorded):
    with pytest.raises(TypeError, match="str has no drawing"):
        recorded([("x", "text", None)])


@pytest.mark.parametrize(
    ("position", "spacing"),
    [(GRID, np.sqrt(1.5 * 1.0 / 12)), (GRID[:4], 0.5), (GRID[:1], 0.2), (GRID[:0], 0.2), (np.ones((3, 3)), 0.2)],
    ids=["grid", "line", "one", "none", "all the same"],
)
def test_spacing(position, spacing):
    assert spacing_m(position) == pytest.approx(spacing)
