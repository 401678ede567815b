"""Every kind of record, read back by a reader that is not ours."""

import math
import pickle
import subprocess
import sys
import time

import cv2
import numpy as np
import pytest
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from hypothesis import given
from hypothesis import strategies as st

from omnilab import api
from omnilab.errors import DataError, PluginError
from omnilab_mcap import McapSink
from omnilab_mcap.vectors import add_vectors


@pytest.fixture(scope="module")
def topics(run, read):
    return read(run / "run.mcap")


@pytest.fixture
def written(tmp_path, read):
    """A function: the log of these (path, record, tick), by topic."""

    def written(*entries):
        sink = McapSink()
        sink.open(tmp_path)
        for entry in entries:
            sink.write(*entry)
        sink.close()
        return read(tmp_path / "run.mcap")

    return written


def only(topics, topic, schema):
    (entry,) = topics[topic]
    assert entry.schema.name == schema
    return entry.decoded


def xyz(point):
    return [point.x, point.y, point.z]


def columns(cloud):
    """A point cloud's columns by name, unpacked as its own description says."""
    kind = {
        "names": [field.name for field in cloud.fields],
        "formats": [{7: "<f4", 1: "u1"}[field.type] for field in cloud.fields],  # FLOAT32, UINT8
        "offsets": [field.offset for field in cloud.fields],
        "itemsize": cloud.point_stride,
    }
    return np.frombuffer(cloud.data, np.dtype(kind))


def segments(update):
    """The lines of a scene by the id of their entity: (N, 2, 3)."""
    return {
        entity.id: np.array([xyz(point) for line in entity.lines for point in line.points]).reshape(-1, 2, 3)
        for entity in update.entities
    }


def test_image(topics, records):
    image = only(topics, "/camera/image", "foxglove.CompressedImage")
    assert (image.format, image.frame_id) == ("png", "camera")
    pixels = cv2.imdecode(np.frombuffer(image.data, np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(pixels[..., ::-1], records["camera/image"].pixels)


def test_image_that_the_recorder_has_encoded(written):
    image = api.Image(np.zeros((2, 2), np.uint8), encoded=b"as given")
    assert written(("/image", image, None))["/image"][0].decoded.data == b"as given"


def test_pose_and_its_frame(topics):
    pose = only(topics, "/camera/pose", "foxglove.PoseInFrame")
    camera, plane = only(topics, "/tf", "foxglove.FrameTransforms").transforms
    assert pose.frame_id == camera.parent_frame_id == "world"
    assert camera.child_frame_id == plane.parent_frame_id == "camera"
    assert xyz(pose.pose.position) == xyz(camera.translation) == [1, 2, 3]
    assert (xyz(plane.translation), xyz(plane.rotation), plane.rotation.w) == ([0, 0, 0], [0, 0, 0], 1)
    half = math.sqrt(0.5)  # a quarter turn about +z: (0, 0, sin 45°, cos 45°)
    for turn in pose.pose.orientation, camera.rotation:
        assert [turn.x, turn.y, turn.z, turn.w] == pytest.approx([0, 0, half, half])


def test_signature(topics, records):
    picture = only(topics, "/camera/signature", "foxglove.RawImage")
    assert (picture.encoding, picture.step) == ("32FC1", 4 * picture.width)
    values = np.frombuffer(picture.data, "<f4").reshape(picture.height, picture.width)
    np.testing.assert_array_equal(values, records["/camera/signature"].values)


def test_places(topics, records):
    places = only(topics, "/places", "foxglove.PosesInFrame")
    assert places.frame_id == "world"
    np.testing.assert_array_equal([xyz(pose.position) for pose in places.poses], records["/places"].position_m)
    headings = [2 * math.atan2(pose.orientation.z, pose.orientation.w) for pose in places.poses]
    np.testing.assert_allclose(headings, records["/places"].heading_rad)


def test_places_without_headings(topics, records):
    cloud = columns(only(topics, "/sites", "foxglove.PointCloud"))
    np.testing.assert_array_equal(np.stack([cloud["x"], cloud["y"], cloud["z"]], -1), records["/sites"].position_m)


def test_distance_field(topics):
    field = only(topics, "/distances", "foxglove.PointCloud")
    assert (field.frame_id, field.pose.orientation.w) == ("world", 1)
    np.testing.assert_array_equal(
        [list(point) for point in columns(field)], [[0, 0, 1, 0.5], [0.5, 0, 1, 0.25], [0, 0.25, 1, 4]]
    )


def test_point_cloud(topics, records):
    cloud = columns(only(topics, "/cloud", "foxglove.PointCloud"))
    np.testing.assert_array_equal(np.stack([cloud["x"], cloud["y"], cloud["z"]], -1), records["/cloud"].points_m)
    colors = np.stack([cloud["red"], cloud["green"], cloud["blue"]], -1)
    np.testing.assert_array_equal(colors, records["/cloud"].colors)
    assert (cloud["alpha"] == 255).all()


def test_estimate(topics, tick):
    estimate = only(topics, "/query", "omnilab.Estimate")
    assert (xyz(estimate.truth_m), xyz(estimate.answer_m)) == ([0, 0, 1], [0.5, 0, 1])
    assert (estimate.verdict, estimate.step) == ("second", tick.step)
    assert (estimate.truth_heading_rad, estimate.answer_heading_rad) == (0.5, -0.25)
    assert segments(only(topics, "/query/line", "foxglove.SceneUpdate"))["second"].tolist() == [
        [[0, 0, 1], [0.5, 0, 1]]
    ]


def test_estimate_without_heading(topics):
    assert math.isnan(only(topics, "/lost", "omnilab.Estimate").answer_heading_rad)


def test_answers(topics, records):
    update = only(topics, "/answers", "foxglove.SceneUpdate")
    ends = np.stack([records["/answers"].truth_m, records["/answers"].answer_m], axis=1)
    shown = segments(update)
    assert set(shown) == {"nearest", "wrong"}
    np.testing.assert_array_equal(shown["nearest"], ends[[0, 2]])
    np.testing.assert_array_equal(shown["wrong"], ends[[1]])
    assert {entity.frame_id for entity in update.entities} == {"world"}
    assert {line.type for entity in update.entities for line in entity.lines} == {2}  # LINE_LIST


def test_mesh(topics, records):
    (entity,) = only(topics, "/room", "foxglove.SceneUpdate").entities
    (surface,) = entity.triangles
    np.testing.assert_array_equal([xyz(point) for point in surface.points], records["/room"].vertices_m)
    np.testing.assert_array_equal(np.reshape(surface.indices, (-1, 3)), records["/room"].triangles)
    assert [(c.r, c.g, c.b, c.a) for c in surface.colors] == [
        (1, 0, 0, 1),
        (0, 1, 0, 1),
        (0, 0, 1, 1),
        (0.2, 0.2, 0.2, 1),
    ]


def test_series(topics, records):
    rows = topics["/error"]
    assert {row.schema.name for row in rows} == {"omnilab.Scalar"}
    assert [row.decoded.value for row in rows] == records["/error"].values.tolist()
    assert [row.decoded.step for row in rows] == [row.message.sequence for row in rows] == [3, 4, 5]
    assert [row.decoded.timestamp.ToNanoseconds() for row in rows] == records["/error"].stamps_ns.tolist()
    assert {row.decoded.unit for row in rows} == {"m"}


def test_text(topics):
    line = only(topics, "/log", "foxglove.Log")
    assert (line.message, line.name, line.Level.Name(line.level)) == ("the map is ready", "/log", "WARNING")


def test_what_concerns_screens_is_left_out(topics, records):
    assert set(topics) == {f"/{path.strip('/')}" for path in records} - {"/progress", "/layout"} | {
        "/tf",
        "/query/line",
        "/lost/line",
    }


@given(st.lists(st.floats(width=32, allow_nan=False), max_size=20))
def test_values_survive_to_the_bit(tmp_path_factory, read, values):
    folder, steps = tmp_path_factory.mktemp("values"), np.arange(len(values))
    sink = McapSink()
    sink.open(folder)
    sink.write("/curve", api.Series(np.array(values), steps, steps, "1"), None)
    sink.write("/signature", api.Signature(np.array(values, np.float32)[None]), None)
    sink.close()
    topics = read(folder / "run.mcap")
    assert [row.decoded.value for row in topics["/curve"]] == values
    assert np.frombuffer(only(topics, "/signature", "foxglove.RawImage").data, "<f4").tolist() == values


def test_times_of_a_record_with_a_tick(topics, tick):
    (entry,) = topics["/log"]
    assert entry.decoded.timestamp.ToNanoseconds() == tick.stamp_ns
    assert entry.message.publish_time == entry.message.log_time
    assert entry.message.sequence == tick.step


def test_times_of_a_record_that_holds_for_the_whole_run(written):
    before = time.time_ns()
    (entry,) = written(("/log", api.Text("hello"), None))["/log"]
    assert before <= entry.message.log_time <= time.time_ns()
    assert entry.decoded.timestamp.ToNanoseconds() == entry.message.publish_time == entry.message.log_time


def test_the_clock_never_steps_back(written, monkeypatch):
    clock = iter([5, 9, 7, 8, 12])
    monkeypatch.setattr(time, "time_ns", lambda: next(clock))
    topics = written(*[("/log", api.Text("tick"), None)] * 4)
    assert [entry.message.log_time for entry in topics["/log"]] == [9, 9, 9, 12]


def test_all_of_a_step_lies_at_one_time_a_curve_that_comes_after_it_too(written, monkeypatch):
    clock = iter([100, 200, 300, 400, 500, 600])
    monkeypatch.setattr(time, "time_ns", lambda: next(clock))
    line, steps = api.Text("x"), np.arange(8)
    ticks = [api.Tick(step, 0) for step in (2, 6, 2)]
    curve = api.Series(np.zeros(8), steps, steps, "m")
    topics = written(
        *[("/log", line, tick) for tick in ticks], ("/error", curve, None), ("/late", line, api.Tick(7, 0))
    )
    assert [(e.message.sequence, e.message.log_time) for e in topics["/log"]] == [(2, 200), (2, 200), (6, 300)]
    # between steps that are known, and after them all in the time since the record before
    assert [e.message.log_time for e in topics["/error"]] == [200, 200, 200, 225, 250, 275, 300, 500]
    assert [e.message.log_time for e in topics["/late"]] == [500]


def test_rows_of_new_steps_are_spread_over_the_time_since_the_last_record(written, monkeypatch):
    clock = iter([100, 200, 300, 400])
    monkeypatch.setattr(time, "time_ns", lambda: next(clock))
    steps = np.arange(4)
    curves = [api.Series(np.zeros(4), steps + first, steps, "m") for first in (0, 4)]
    topics = written(("/progress", api.Progress("map", 1, 2), None), *[("/error", curve, None) for curve in curves])
    assert [e.message.log_time for e in topics["/error"]] == [225, 250, 275, 300, 325, 350, 375, 400]


def test_two_kinds_under_one_path(tmp_path):
    sink = McapSink()
    sink.open(tmp_path)
    sink.write("/here", api.Text("hello"), None)
    with pytest.raises(PluginError, match=r"'/here' holds foxglove\.Log, not foxglove\.RawImage; log one kind"):
        sink.write("/here", api.Signature(np.zeros((2, 2), np.float32)), None)
    sink.close()


@pytest.mark.parametrize("name", ["absent", "file", "run"])
def test_folder_that_cannot_be_written(tmp_path, name):
    (tmp_path / "file").touch()
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run.mcap").write_text("an earlier log")
    with pytest.raises(DataError, match=r"run.mcap cannot be created \(.*\); choose a new, writable run folder"):
        McapSink().open(tmp_path / name)
    assert (tmp_path / "run" / "run.mcap").read_text() == "an earlier log"


DISK_FULL = """
import resource, signal, sys
from pathlib import Path
import numpy as np
from omnilab import api
from omnilab_mcap import McapSink

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
sink = McapSink()
sink.open(Path(sys.argv[1]))
resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000))
noise = np.random.default_rng(0).normal(size=(100, 100)).astype(np.float32)
try:
    for _ in range(3):
        sink.write("/noise", api.Signature(noise), None)
        sink.flush()
except OSError as error:
    print("raised", error.strerror)
"""


def test_failing_disk_raises_and_what_was_whole_stays(tmp_path, read):
    done = subprocess.run([sys.executable, "-c", DISK_FULL, tmp_path], capture_output=True, text=True, check=True)
    assert done.stdout == "raised File too large\n"
    McapSink().repair(tmp_path)
    assert len(read(tmp_path / "run.mcap")["/noise"]) == 1


def test_fresh_sink_pickles():
    assert pickle.loads(pickle.dumps(McapSink())) == McapSink()


def test_writing_to_a_closed_sink():
    with pytest.raises(RuntimeError, match=r"call open\(folder\) first"):
        McapSink().write("/log", api.Text("hello"), None)


def test_import_is_light():
    code = "import sys, omnilab_mcap; print([m for m in sys.modules if m.split('.')[0] in ('mcap', 'google', 'zstandard')])"
    assert subprocess.check_output([sys.executable, "-c", code], text=True) == "[]\n"


def test_vectors_are_put_into_a_message_as_protobuf_would():
    values = np.array([[0.0, -0.0, 1.5], [np.nan, np.inf, -1e300], [0.1, 0.0, 2.0]])
    one_by_one, at_once = (LinePrimitive(points=[Point3(x=7.0)], thickness=2.0) for _ in range(2))
    one_by_one.points.extend(Point3(x=x, y=y, z=z) for x, y, z in values.tolist())
    one_by_one.colors.extend(Color(r=r, g=g, b=b, a=0.5) for r, g, b in values.tolist())
    add_vectors(at_once, "points", values)
    add_vectors(at_once, "colors", np.column_stack([values, np.full(3, 0.5)]))
    add_vectors(at_once, "points", np.empty((0, 3), np.float32))
    assert at_once.SerializeToString() == one_by_one.SerializeToString()
