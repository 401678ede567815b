"""Data sets from a sensor so plain that every pixel, pose and point is known."""

import contextlib
import csv
import json
from dataclasses import dataclass, field
from typing import ClassVar

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnilab.api import Circle, Frames, GridPoses, Parts, PathPoses, Plan, RandomPoses, RecordedPoses
from omnilab.cameras import EquirectangularCamera, ImageCircle, load_camera
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import planar_poses, poses, rotation_xyz
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_study
from omnilab.trajectory.files import read_trajectory
from omnilab_studies import Render
from omnilab_studies.common.dataset_files import DataSet
from omnilab_studies.common.image_columns import column_poses
from omnilab_studies.datasets.render.study import Where

CAMERA = EquirectangularCamera(24, 12)


@dataclass
class Ball:
    """A grey or coloured ball of radius 2 around every camera; the picture tells the frame's x and y."""

    depth: bool = False
    color: bool = False
    circle: bool = False  # uncalibrated
    placed: bool = True
    broken: list[str] = field(default_factory=list)  # keys that are not delivered

    ends_after: ClassVar[int] = 10**9  # frames that are imaged before Ctrl-C

    def __post_init__(self):
        self.asked = []

    def plan(self, layout):
        match layout:
            case GridPoses():
                x, y = np.meshgrid(layout.step_m * np.arange(4), layout.step_m * np.arange(3))
                T = planar_poses(np.stack([x.ravel() - 1, y.ravel(), np.full(12, 1.0)], -1))
            case RandomPoses():
                rng = np.random.default_rng(layout.seed)
                T = poses(rng.uniform(-1, 1, (layout.count, 3)), rotation_xyz(*rng.uniform(-3, 3, (3, layout.count))))
            case PathPoses():
                T = layout.T_world_camera
            case RecordedPoses():
                T = planar_poses(np.zeros((5, 3)))
        return Plan([f"key, {i}" for i in range(len(T))], T if self.placed else None, ["(9, 9): inside 'box'"])

    def frames(self, plan):
        for start in range(0, len(plan), 50):
            index = np.array(
                [i for i in range(start, min(start + 50, len(plan))) if plan.keys[i] not in self.broken], int
            )
            omitted = [f"{key}: torn" for key in plan.keys[start : start + 50] if key in self.broken]
            if len(index) == 0:
                raise DataError("none can be read")
            if len(self.asked) + len(index) > self.ends_after:
                raise KeyboardInterrupt
            part = plan.at(index)
            self.asked += part.keys
            numbers = np.array([int(key.split()[1]) for key in part.keys])
            images = np.empty((len(index), 12, 24, 3), np.uint8)
            images[:] = np.stack([numbers % 251, numbers // 251, 7 + 0 * numbers], -1)[:, None, None]
            images = images if self.color else images[..., 0]
            camera = ImageCircle(24, 12, Circle(11.5, 5.5, 6, 1)) if self.circle else CAMERA
            depth = np.full((len(index), 12, 24), 2, np.float32) if self.depth else None
            stamps = 10**18 + 7 * numbers
            yield Frames(images, part.keys, stamps, camera, index, part.T_world_camera, omitted, depth)

    def scene(self):
        return None


def run(folder, sensor=None, **settings):
    study = Render(str(folder), **settings)
    return study.run(Parts(sensor=sensor or Ball()), Recorder(), np.random.default_rng(0))


def metrics(report):
    return {metric.name: metric.value for metric in report.metrics}


def rows(folder):
    with (folder / "positions.csv").open(newline="") as stream:
        return list(csv.DictReader(stream))


def poses_in(folder):
    """`T_world_camera` as any reader of CSV gets it."""
    names = [f"r{i}{j}" for i in range(3) for j in range(3)]
    R = np.array([[float(row[name]) for name in names] for row in rows(folder)]).reshape(-1, 3, 3)
    return poses([[float(row[f"{axis}_m"]) for axis in "xyz"] for row in rows(folder)], R)


def files(folder):
    return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def about(folder):
    return json.loads((folder / "dataset.json").read_text())


# ------------------------------------------------------------------------------------------------------------- contents
@pytest.mark.parametrize("color", [False, True])
def test_images_are_lossless_and_named_by_their_frame(tmp_path, color):
    run(tmp_path / "set", Ball(color=color), layout=Where.random, count=300)
    names = [row["image"] for row in rows(tmp_path / "set")]
    assert names == [f"images/{n:06d}.png" for n in range(300)]
    assert sorted(path.name for path in (tmp_path / "set/images").iterdir()) == [name[7:] for name in names]
    found = cv2.imread(str(tmp_path / "set" / names[299]), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(found, np.full((12, 24, 3), [7, 1, 48]) if color else np.full((12, 24), 48))


@given(st.integers(0, 2**32 - 1))
def test_poses_come_back_bit_for_bit(tmp_path_factory, seed):
    folder, rng = tmp_path_factory.mktemp("poses"), np.random.default_rng(seed)
    T = poses(rng.normal(0, 10.0 ** rng.integers(-9, 9), (4, 3)), rotation_xyz(*rng.uniform(-4, 4, (3, 4))))
    stamps = rng.integers(-(2**63), 2**63, 4)
    DataSet(folder).write_poses(np.array([0, 2, 3]), Plan(list("abcd"), T), stamps, None)
    assert np.array_equal(poses_in(folder), T[[0, 2, 3]])
    again = read_trajectory(folder / "positions.csv")
    assert np.array_equal(again.T_world_camera, T[[0, 2, 3]])
    assert np.array_equal(again.stamps_ns, stamps[[0, 2, 3]])
    assert np.array_equal(read_trajectory(folder / "poses.tum").stamps_ns, stamps[[0, 2, 3]])


def test_the_tum_file_is_what_its_readers_expect(tmp_path):
    run(tmp_path / "set", layout=Where.random, count=20)
    table = np.loadtxt(tmp_path / "set/poses.tum")
    T = poses_in(tmp_path / "set")
    assert table.shape == (20, 8)
    assert np.allclose(table[:, 0], 0.1 * np.arange(20), atol=1e-12)
    assert np.array_equal(table[:, 1:4], T[:, :3, 3])
    x, y, z, w = table[:, 4:].T
    assert np.allclose(T[:, 0, 0], 1 - 2 * (y * y + z * z))  # the matrix of a unit quaternion (Hamilton), written out
    assert np.allclose(T[:, 1, 0], 2 * (x * y + z * w))
    assert np.allclose(T[:, 2, 1], 2 * (y * z + x * w))
    assert np.allclose(read_trajectory(tmp_path / "set/poses.tum").T_world_camera, T, atol=1e-12)


def test_a_grid_has_cells_and_the_heading_in_the_plane(tmp_path):
    report = run(tmp_path / "set", step_m=0.25)
    table = rows(tmp_path / "set")
    assert [(int(row["ix"]), int(row["iy"])) for row in table] == [(x, y) for y in range(3) for x in range(4)]
    assert float(table[5]["x_m"]) == -0.75
    assert {row["yaw_deg"] for row in table} == {"0.0"}
    assert table[3]["key"] == "key, 3"
    assert metrics(report) == {"images": 12, "left_out": 1, "bytes_per_image": metrics(report)["bytes_per_image"]}
    size = sum(path.stat().st_size for path in (tmp_path / "set/images").iterdir())
    assert metrics(report)["bytes_per_image"] == size / 12
    assert about(tmp_path / "set")["omitted"] == ["(9, 9): inside 'box'"]


@given(st.floats(-1, 1), st.integers(0, 30), st.sampled_from([0.05, 0.1, 0.25]))
def test_columns_have_both_ends(low, count, step):
    T = column_poses([[0, 1], [2.5, -3]], [low, low + count * step, step])
    assert len(T) == 2 * (count + 1)
    assert np.allclose(T[: count + 1, :3, 3], [(0, 1, low + i * step) for i in range(count + 1)])
    assert np.allclose(T[count + 1 :, :2, 3], [2.5, -3])
    assert np.array_equal(T[:, :3, :3], np.tile(np.eye(3), (len(T), 1, 1)))


def test_the_camera_comes_along_or_its_circle(tmp_path):
    run(tmp_path / "known")
    assert load_camera(tmp_path / "known/camera.json") == CAMERA
    run(tmp_path / "circle", Ball(circle=True))
    assert not (tmp_path / "circle/camera.json").exists()
    assert about(tmp_path / "circle")["camera"]["circle_px"] == [11.5, 5.5, 6, 1]


def test_depth_and_points_lie_where_the_world_is(tmp_path):
    """The world is a ball of radius 2 around each camera: so far are all points from the nearest camera, or nearer."""
    report = run(tmp_path / "set", Ball(depth=True, color=True), layout=Where.random, count=3, cloud_points=600)
    depth = np.load(tmp_path / "set/depth/000002.npy", allow_pickle=False)
    assert depth.dtype == np.float32
    assert (depth == 2).all()
    header, body = (tmp_path / "set/cloud.ply").read_bytes().split(b"end_header\n")
    assert header.decode().splitlines() == [
        "ply", "format binary_little_endian 1.0", "element vertex 288",
        "property float x", "property float y", "property float z",
        "property uchar red", "property uchar green", "property uchar blue",
    ]  # fmt: skip
    points = np.frombuffer(body, [("xyz", "<f4", 3), ("rgb", "u1", 3)])
    assert metrics(report)["cloud_points"] == len(points) == 288  # one image would do, and has no more pixels
    center = poses_in(tmp_path / "set")[0, :3, 3]
    assert np.allclose(np.linalg.norm(points["xyz"] - center, axis=1), 2, atol=1e-5)
    assert (points["rgb"] == [0, 0, 7]).all()


def test_a_recording_keeps_its_times_and_may_have_no_positions(tmp_path):
    run(tmp_path / "placed", layout=Where.recorded)
    assert [int(row["stamp_ns"]) for row in rows(tmp_path / "placed")] == [10**18 + 7 * i for i in range(5)]
    run(tmp_path / "bare", Ball(placed=False), layout=Where.recorded)
    left = sorted(path.name for path in (tmp_path / "bare").iterdir())
    assert left == ["camera.json", "dataset.json", "images", "stamps.csv"]


def test_frames_that_are_not_delivered_are_told_and_leave_a_gap(tmp_path):
    sensor = Ball(broken=["key, 1"])
    for _ in range(2):
        report = run(tmp_path / "set", sensor, layout=Where.recorded)
        assert metrics(report)["images"] == 4
        assert metrics(report)["left_out"] == 2
        assert [row["image"][-7:-4] for row in rows(tmp_path / "set")] == ["000", "002", "003", "004"]
        assert about(tmp_path / "set")["not_delivered"] == ["key, 1: torn"]


@pytest.mark.parametrize(
    ("sensor", "settings"),
    [
        (Ball(), {}),
        (Ball(color=True), {"layout": Where.column}),
        (Ball(), {"layout": Where.random, "count": 1}),
        (Ball(placed=False), {"layout": Where.recorded}),
    ],
)
def test_the_sheet_shows_images_beside_their_poses(tmp_path, sensor, settings):
    figure = run(tmp_path / "set", sensor, **settings).figures["images"]
    figure.savefig(tmp_path / "sheet.png", dpi=30)
    shown = [axes.get_images() for axes in figure.axes if axes.get_images()]
    count = len(list((tmp_path / "set/images").iterdir()))
    assert len(shown) == min(count, 6)
    assert len(figure.axes) == 6 + sensor.placed


def test_the_study_keeps_the_contract(tmp_path):
    check_study(Render(str(tmp_path / "set"), show=1), Parts(sensor=Ball()))


# -------------------------------------------------------------------------------------------------------------- resuming
def test_what_was_interrupted_is_gone_on_with(tmp_path, monkeypatch):
    settings = {"layout": Where.random, "count": 400}
    run(tmp_path / "whole", **settings)
    monkeypatch.setattr(Ball, "ends_after", 200)
    there = [0]
    while not (tmp_path / "set/dataset.json").exists() or not about(tmp_path / "set")["complete"]:
        with contextlib.suppress(KeyboardInterrupt):
            run(tmp_path / "set", **settings)
        there.append(len(list((tmp_path / "set/images").iterdir())))
        assert there[-1] > there[-2]
        (tmp_path / "set/images/000003.png").write_bytes(b"")  # as a full disk leaves it
    assert len(there) > 3
    run(tmp_path / "set", **settings)
    assert files(tmp_path / "set") == files(tmp_path / "whole")


def test_what_is_whole_is_not_made_again(tmp_path):
    run(tmp_path / "set", layout=Where.random, count=400)
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "set/images").iterdir()}
    sensor = Ball()
    run(tmp_path / "set", sensor, layout=Where.random, count=400)
    assert len(sensor.asked) == 64  # one part, for the camera
    assert before == {path: path.stat().st_mtime_ns for path in (tmp_path / "set/images").iterdir()}


@pytest.mark.parametrize(
    ("sensor", "settings", "what"),
    [
        (Ball(color=True), {}, "sensor.color is False, not True"),
        (Ball(), {"step_m": 0.3}, "plan is"),
        (Ball(), {"layout": Where.random}, "planned is 12, not 100"),
    ],
)
def test_another_data_set_in_the_folder_is_refused(tmp_path, sensor, settings, what):
    run(tmp_path / "set")
    before = files(tmp_path / "set")
    with pytest.raises(DataError, match=f"another data set: its {what}.*give a new folder"):
        run(tmp_path / "set", sensor, **settings)
    assert files(tmp_path / "set") == before


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"sensor": 1}', "[" * 100_000, '{"sensor": NaN'])
def test_a_folder_that_holds_something_else_is_refused(tmp_path, text):
    (tmp_path / "dataset.json").write_text(text)
    with pytest.raises(DataError, match=r"dataset.json describes no data set .*give a new study.folder"):
        run(tmp_path)
    (tmp_path / "dataset.json").rename(tmp_path / "mine.json")
    with pytest.raises(DataError, match="neither empty nor a data set; give a new folder"):
        run(tmp_path)
    with pytest.raises(DataError, match="is a file; give a new folder"):
        run(tmp_path / "mine.json")
    with pytest.raises(DataError, match=r"cannot be written \(Not a directory\)"):
        run(tmp_path / "mine.json/set")


# ------------------------------------------------------------------------------------------------------------- bad input
@pytest.mark.parametrize(
    ("settings", "fix"),
    [
        ({"layout": Where.random, "step_m": 0.4}, "study.step_m=0.4 means nothing to study.layout=random.*layout=grid"),
        ({"height_m": 1.0, "layout": Where.column}, "study.height_m=1.0.*study.layout=grid or path or random"),
        ({"path": "a.txt"}, "study.path=a.txt means nothing to study.layout=grid"),
        ({"layout": Where.path}, "study.path is null; give a path of the world or FILE"),
        ({"step_m": 0.2, "every": 2}, "study.step_m=0.2 with study.every=2"),
        ({"step_m": float("nan")}, "study.step_m=nan"),
        ({"extent_m": [1.0]}, "give 2 numbers above 0"),
        ({"layout": Where.column, "heights_m": [1.0, 0.5, 0.1]}, r"\[lowest, highest, step\]"),
        ({"layout": Where.column, "heights_m": [1.0, 2.0, 0.0]}, r"\[lowest, highest, step\]"),
        ({"layout": Where.column, "positions_m": [[1.0]]}, r"give \[\[x, y\], ...\]"),
        ({"layout": Where.column, "positions_m": [1.0, 2.0]}, r"give \[\[x, y\], ...\]"),
        ({"layout": Where.column, "positions_m": []}, r"give \[\[x, y\], ...\]"),
        ({"layout": Where.random, "count": 0}, "study.count=0 is out of range; give a whole number from 1"),
        ({"processes": 0}, "study.processes=0 is out of range"),
        ({"cloud_points": -1}, "study.cloud_points=-1 is out of range"),
        ({"cloud_points": 10**9}, "give a whole number from 0 to 50000000"),
    ],
)
def test_settings_that_make_no_data_set_are_refused(settings, fix):
    with pytest.raises(ConfigError, match=fix):
        Render("folder", **settings)


def test_a_cloud_needs_depth_and_a_calibrated_camera(tmp_path):
    with pytest.raises(DataError, match=r"no depth; give sensor\.depth=true"):
        run(tmp_path / "set", cloud_points=10)
    with pytest.raises(DataError, match=r"calibrated camera and poses; give study\.cloud_points=0"):
        run(tmp_path / "circle", Ball(depth=True, circle=True), cloud_points=10)


def test_a_sensor_that_delivers_nothing_is_said(tmp_path):
    class Nothing(Ball):
        def frames(self, plan):
            return iter([])

    with pytest.raises(DataError, match="none of 12 images"):
        run(tmp_path / "set", Nothing())


# ---------------------------------------------------------------------------------------------------------- trajectories
ROTATION = rotation_xyz(0.1, -0.2, 0.3)


@pytest.mark.parametrize(
    ("name", "text", "R"),
    [
        ("p.txt", "# t tx ty tz qx qy qz qw\n\n1.5 1 2 3 0 0 0.7071068 0.7071068\n", rotation_xyz(0, 0, np.pi / 2)),
        ("p.csv", "z_m,y_m,x_m\n3,2,1\n", np.eye(3)),
        ("p.csv", "x_m,y_m,z_m,yaw_deg\n1,2,3,90\n", rotation_xyz(0, 0, np.pi / 2)),
        ("p.csv", f"x_m,y_m,z_m,rx_deg,ry_deg,rz_deg\n1,2,3,{','.join(map(str, np.rad2deg([0.1, -0.2, 0.3])))}\n", ROTATION),
        ("P.CSV", "\ufeffx_m, y_m,z_m,qw,qx,qy,qz,note\n1,2,3,0,1,0,0,?\n", np.diag([1, -1, -1])),
        ("p.csv", "x_m,y_m,z_m,yaw_deg,r00,r01,r02,r10,r11,r12,r20,r21,r22\n1,2,3,7,1,0,0,0,0,-1,0,1,0\n",
         rotation_xyz(np.pi / 2, 0, 0)),
    ],
)  # fmt: skip
def test_paths_come_in_several_notations(tmp_path, name, text, R):
    (tmp_path / name).write_text(text, encoding="utf-8")
    found = read_trajectory(tmp_path / name)
    assert np.allclose(found.T_world_camera, poses([1, 2, 3], R), atol=1e-7)
    assert (found.stamps_ns is None) == name.lower().endswith("csv")


def test_times_of_a_path_are_exact(tmp_path):
    (tmp_path / "p.tum").write_text("1403636579.763555527 0 0 0 0 0 0 1\n-0.5 0 0 0 0 0 0 1\n")
    assert list(read_trajectory(tmp_path / "p.tum").stamps_ns) == [1403636579763555527, -500_000_000]
    run(tmp_path / "set", layout=Where.path, path=str(tmp_path / "p.tum"))
    assert (tmp_path / "set/poses.tum").read_text().split()[::8] == ["1403636579.763555527", "-0.500000000"]


@pytest.mark.parametrize(
    ("name", "text", "fix"),
    [
        ("p.txt", "0 1 2 3 0 0 0 1\n1 1 2 3 0 0 0\n", "line 2 of .* has 7 values for 8 columns; write t tx ty tz"),
        ("p.txt", "0 1 2 x 0 0 0 1\n", r"line 1 of .* has tz='x' \(column 4\); write a finite number"),
        ("p.txt", "nan 1 2 3 0 0 0 1\n", r"t='nan' \(column 1\)"),
        ("p.txt", "1e300 1 2 3 0 0 0 1\n", r"t='1e300' \(column 1\); write a time"),
        ("p.txt", "0 1 2 3 0 0 0 2\n", r"line 1 .* = \[0.0, 0.0, 0.0, 2.0\], no unit quaternion; write a proper"),
        ("p.txt", "0 1 2 3 0 0 0 0\n", "no unit quaternion"),
        ("p.txt", "# nothing\n", "holds no pose"),
        ("p.csv", "", "holds no pose"),
        ("p.csv", "x_m,y_m\n1,2\n", "no column z_m, only x_m, y_m; add it"),
        ("p.csv", "x_m,y_m,z_m\n1,2,inf\n", r"line 2 of .* has z_m='inf' \(column 3\)"),
        ("p.csv", "x_m,y_m,z_m\n1,2,3\n1,2\n", "line 3 of .* has 2 values for 3 columns"),
        ("p.csv", "x_m,y_m,z_m,x_m\n1,2,3,4\n", "two columns of one name"),
        ("p.csv", "x_m,y_m,z_m,qx,qy,qz\n1,2,3,0,0,0\n", "lacks qw; give all of qx, qy, qz, qw"),
        ("p.csv", "x_m,y_m,z_m,r00,r01,r02,r10,r11,r12,r20,r21,r22\n1,2,3,1,0,0,0,1,0,0,0,-1\n", "no rotation matrix"),
        ("p.csv", 'x_m,y_m,z_m\n1,2,"3\n', "line 2 of .* a quotation mark that does not close"),
        ("absent.txt", None, "cannot be read .*TUM's or KITTI's format"),
    ],
)  # fmt: skip
def test_a_broken_path_is_told_by_line_and_column(tmp_path, name, text, fix):
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(DataError, match=fix):
        read_trajectory(tmp_path / name)


def test_binary_is_no_path(tmp_path):
    (tmp_path / "p.txt").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DataError, match="no text of poses"):
        read_trajectory(tmp_path / "p.txt")
