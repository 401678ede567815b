"""One reader of pose tables: CSV, TUM, KITTI; columns by other words; what is no table at all."""

from __future__ import annotations

import json
import sqlite3
import zipfile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnilab.errors import DataError
from omnilab.file_kinds import kind_of_file
from omnilab.geometry import heading_of, poses, rotation_xyz
from omnilab.trajectory.columns import COLUMNS
from omnilab.trajectory.files import kitti_text, read_trajectory, tum_text
from omnilab.trajectory.lookalikes import misnamed
from omnilab.trajectory.tables import PoseTable, read_table

T = poses(np.random.default_rng(1).normal(0, 5, (9, 3)), rotation_xyz(0.1, -0.2, np.linspace(-3, 3, 9)))


def write(tmp_path, text, name="poses.csv", encoding="utf-8"):
    (tmp_path / name).write_bytes(text.encode(encoding))
    return tmp_path / name


def read_positions(file):
    """All that a folder of images reads from a table."""
    table: PoseTable = read_table(file)
    return table.images(), table.position_m(level=True), table.rotations(), table.cells(), table.stamps_ns()


# ------------------------------------------------------------------------------------------------------------- formats
def test_kitti_and_tum_read_back_what_is_written(tmp_path):
    kitti = read_trajectory(write(tmp_path, kitti_text(T), "poses.kitti"))
    assert np.array_equal(kitti.T_world_camera, T)
    assert kitti.stamps_ns is None
    stamps = np.arange(9) * 10**8 + 1_600_000_000_123_456_789
    for name in ("poses.tum", "poses.txt", "poses.csv"):  # by its content, whatever it is called
        tum = read_trajectory(write(tmp_path, tum_text(T, stamps), name))
        assert np.allclose(tum.T_world_camera, T, atol=1e-12)
        assert tum.stamps_ns.tolist() == stamps.tolist()


def test_kitti_of_few_digits_and_with_comments(tmp_path):
    text = "".join(" ".join(f"{v:.6e}" for v in row) + "\r\n" for row in T[:, :3].reshape(-1, 12))
    found = read_trajectory(write(tmp_path, f"# ground truth\n\n{text}", "00.txt")).T_world_camera
    assert np.allclose(found, T, atol=1e-5)


@pytest.mark.parametrize(("header", "row"), [
    ("x_m,y_m,z_m,yaw_deg", "1,2,3,30"),
    ("x_cm,y_mm,z_m,yaw_rad", f"100,2000,3,{np.pi / 6!r}"),
    ("height_m,x_m,y_m,heading_deg", "3,1,2,60"),
    ("x_m,y_m,height_cm,yaw_deg,yaw,theta,x,lat", "1,2,300,30,7,7,7,7"),  # what has no use beside the right column
    ("x_m,y_m,z_m,rx_rad,ry_rad,rz_rad", f"1,2,3,0,0,{np.pi / 6!r}"),
    ("tx,ty,tz,qx,qy,qz,qw", "1,2,3,0,0,0.2588190451025207,0.9659258262890683"),
])  # fmt: skip
def test_one_pose_in_every_unit(tmp_path, header, row):
    found = read_trajectory(write(tmp_path, f"{header}\n{row}\n"))
    assert np.allclose(found.T_world_camera, poses([1, 2, 3], rotation_xyz(0, 0, np.pi / 6)), atol=1e-12)
    assert found.stamps_ns is None


@pytest.mark.parametrize(("column", "value"), [
    ("stamp_ns", "1600000000123456789"), ("stamp_us", "1600000000123456.789"), ("stamp_ms", "1600000000123.456789"),
    ("stamp_s", "1600000000.123456789"), ("stamp_s", "1.600000000123456789e+09"),
])  # fmt: skip
def test_one_time_in_every_unit(tmp_path, column, value):
    found = read_trajectory(write(tmp_path, f"x_m,y_m,z_m,{column}\n1,2,3,{value}\n"))
    assert found.stamps_ns.tolist() == [1600000000123456789]


def test_what_spreadsheets_leave_behind(tmp_path):
    text = '\ufefffile, x_m ,y_m,,\r\n,,,,\r\na.png,1,"2",,\r\n ,,,,\r\nb.png,3,4\r\n,,\r\n'.replace("file", "image")
    with pytest.raises(DataError, match=r"line 5 of .* has 3 values for 5 columns"):
        read_table(write(tmp_path, text))
    table = read_table(write(tmp_path, text.replace("b.png,3,4", "b.png,3,4,,,")))
    assert table.images() == ["a.png", "b.png"]
    assert table.position_m(level=True).tolist() == [[1, 2, 0], [3, 4, 0]]


@given(st.lists(st.integers(0, 3), max_size=9), st.integers(1, 5))
def test_rows_of_commas_never_count(tmp_path_factory, gaps, columns):
    header = ",".join(COLUMNS[1 : columns + 3])
    rows = [",".join([str(i)] * (columns + 2)) for i in range(len(gaps))]
    lines = [line for row, gap in zip(rows, gaps, strict=True) for line in [row, *["," * (columns + 1)] * gap]]
    file = tmp_path_factory.mktemp("rows") / "p.csv"
    file.write_text("\n".join([header, "9" + ",9" * (columns + 1), *lines]))
    assert read_table(file).floats(["x_m"])[:, 0].tolist() == [9, *range(len(gaps))]


# ------------------------------------------------------------------------------------------------------- columns' names
@pytest.mark.parametrize(("column", "right"), [
    ("yaw", "write yaw_deg .*, yaw_rad .* or heading_deg"), ("theta", "write yaw_deg"), ("heading", "write yaw_deg"),
    ("Yaw_deg", "name it yaw_deg"), ("YAW_DEG", "name it yaw_deg"), ("yaw_degrees", "name it yaw_deg"),
    ("Yaw (deg)", "name it yaw_deg"), ("yawDeg", "name it yaw_deg"), ("theta_rad", "name it yaw_rad"), ("psi", "write"),
    ("azimuth_deg", "clockwise from north"), ("heading_rad", "clockwise from north"), ("orientation", "write yaw_deg"),
    ("Heading_deg", "name it heading_deg"), ("gps_heading", "write yaw_deg"), ("yaw [°]", "write yaw_deg"),
    ("timestamp", "write stamp_ns, stamp_us"), ("Time", "write stamp_ns"), ("time_s", "name it stamp_s"),
    ("t", "write stamp_ns"), ("#timestamp [ns]", "name it stamp_ns"), ("header.stamp.secs", "name it stamp_s"),
    ("STAMP_NS", "name it stamp_ns"), ("stamp", "write stamp_ns"), ("timestamp_ms", "name it stamp_ms"),
    ("z", "write z_m"), ("height", "write z_m"), ("altitude_m", "name it z_m"), ("Z_M", "name it z_m"), ("alt", "z_m"),
    ("Q_W", "write qx, qy, qz, qw"), ("QW", "name it qw"), ("pose.pose.orientation.w", "write qx"), ("q0", "w is the real"),
    ("roll", "write rx_deg"), ("pitch_deg", "write rx_deg"), ("R00", "name it r00"), ("r33", "counted from 0"),
    ("IX", "name it ix"), ("grid_y", "name it iy"),
])  # fmt: skip
def test_a_column_that_looks_like_one_is_refused_with_the_right_word(tmp_path, column, right):
    file = write(tmp_path, f'image,x_m,y_m,"{column}"\na.png,1,2,3\n')
    with pytest.raises(DataError, match=rf"^{file} has a column '.*', which is not read; .*{right}.*, or remove it$"):
        read_table(file)


@pytest.mark.parametrize(("columns", "right"), [
    ("X,y_m", "'X', .* write x_m"), ("x,y", "'x'"), ("pos_x,pos_y", "'pos_x'"), ("x_m,Y_M", "name it y_m"), ("px,py", "x_m"),
    ("x_meters,y_meters", "name it x_m"), ("easting,northing", "write x_m"), ("x_km,y_km", "write x_m"), ("x [mm],y_m", "x_mm"),
    ("lat,lon", "degrees are no metres: project them"), ("Longitude,Latitude", "project them"), ("gps.lat,gps.lng", "project"),
    ("pose.position.x,pose.position.y", "write x_m"),
])  # fmt: skip
def test_coordinates_by_other_words(tmp_path, columns, right):
    with pytest.raises(DataError, match=right):
        read_table(write(tmp_path, f"image,{columns}\na.png,1,2\n"))


@pytest.mark.parametrize(("name", "row"), [
    ("room", "3"), ("speed_m_s", "3"), ("id", "3"), ("key", "f30bd86e"), ("exposure_time", "0.1"), ("course_deg", "3"),
    ("direction", "3"), ("u_ceil", "3"), ("label_rotation_deg", "45"), ("file", "b.png"), ("index", "3"), ("", "0"),
    ("time", "night"), ("orientation", "portrait"), ("theta_noise", "3"), ("camera", "3"), ("temperature", "3"),
])  # fmt: skip
def test_other_columns_are_not_read(tmp_path, name, row):
    assert read_table(write(tmp_path, f"image,x_m,y_m,{name}\na.png,1,2,{row}\n")).images() == ["a.png"]


@given(st.sampled_from(COLUMNS))
def test_no_column_of_the_vocabulary_is_refused(name):
    assert misnamed([name], ["1"]) is None
    assert misnamed([name.upper()], ["1"]) or name == "image"


# --------------------------------------------------------------------------------------------------- what is no table
@pytest.mark.parametrize(("text", "sentence"), [
    ("image;x_m;y_m\na.png;1;2\n", "by semicolons; use commas, and points in numbers: 1.5, not 1,5"),
    ("image;x_m;y_m\na.png;1,5;2\n", "by semicolons"),
    ("sep=;\nimage;x_m;y_m\n", "by semicolons"),
    ("image\tx_m\ty_m\na.png\t1\t2\n", "by tabs"),
    ("image,x_m,y_m\na.png,1,5,2,5\n", "line 2 of .* has 5 values for 3 columns; .*with points in numbers: 1.5"),
    ('image,x_m,y_m\na.png,"1,5",2\n', r"x_m='1,5' \(column 2\); write a finite number with a point, 1.5"),
    ("a.png,1,2\nb.png,1,2\n", "has no column image"),
    ("0,1,2,3\n1,1,2,3\n", "line 1 of .* holds numbers; write a header first"),
    ("image,x_m,y_m\n,1,2\n", "line 2 of .* names no image"),
    ("file,x_m,y_m\na.png,1,2\n", "no column image, only file, x_m, y_m; name 'file' so"),
    ("image,x_m,y_m\na.png,1e200,2\n", "x_m='1e200' .*write a finite number below 9e18"),
    ("image,x_m,y_m\na.png,1_000,2\n", "x_m='1_000'"),
    ("image,x_m,y_m,stamp_ns\na.png,1,2,1.6E+18\n", "a whole number of ns, all its digits"),
    ("image,x_m,y_m,stamp_s\na.png,1,2,1600000000000000000\n", r"at most 292 years \(this looks like nanoseconds\)$"),
])  # fmt: skip
def test_text_that_is_almost_a_table(tmp_path, text, sentence):
    file = write(tmp_path, text)
    with pytest.raises(DataError, match=sentence):
        read_positions(file)


def test_other_encodings_are_named(tmp_path):
    text = "image,x_m,y_m\ncafé.png,1,2\n"
    with pytest.raises(DataError, match=r"line 2 of .* is no text in UTF-8; save the file as UTF-8"):
        read_table(write(tmp_path, text, encoding="latin-1"))
    with pytest.raises(DataError, match="is text in UTF-16"):
        read_table(write(tmp_path, text, encoding="utf-16"))
    tum = write(tmp_path, "# café\n0 1 2 3 0 0 0 1\n", "p.tum", "latin-1")
    assert len(read_trajectory(tum).T_world_camera) == 1


def _files(tmp_path):
    np.savez(tmp_path / "p.npz", T=np.eye(4))
    np.save(tmp_path / "p.npy", np.eye(4))
    (tmp_path / "p.json").write_text(json.dumps({"poses": []}))
    (tmp_path / "p.mcap").write_bytes(b"\x89MCAP0\r\n" + bytes(90))
    (tmp_path / "p.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(90))
    (tmp_path / "p.parquet").write_bytes(b"PAR1" + bytes(90))
    (tmp_path / "p.pkl").write_bytes(b"\x80\x04\x95" + bytes(90))
    (tmp_path / "p.g2o").write_text("# a graph\nVERTEX_SE2 0 0 0 0\n")
    (tmp_path / "p.xml").write_text("<?xml version='1.0'?><sdf/>")
    (tmp_path / "p.bin").write_bytes(bytes(range(200)))
    with zipfile.ZipFile(tmp_path / "p.xlsx", "w") as archive:
        archive.writestr("[Content_Types].xml", "")
        archive.writestr("xl/workbook.xml", "")
    with sqlite3.connect(tmp_path / "p.db3") as database:
        database.execute("create table t (a)")
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "metadata.yaml").write_text("")


@pytest.mark.parametrize(("name", "words"), [
    ("p.npz", "a NumPy archive"), ("p.npy", "a NumPy array"), ("p.json", "JSON"), ("p.mcap", "an MCAP log"),
    ("p.bag", "a ROS 1 bag"), ("p.parquet", "a Parquet table"), ("p.pkl", "a Python pickle, which is never read"),
    ("p.g2o", "a pose graph"), ("p.xml", "XML"), ("p.bin", "a binary file"), ("p.xlsx", "Excel"), ("p.db3", "an SQLite"),
    ("bag", "the folder of a ROS 2 bag"), (".", "a folder"),
])  # fmt: skip
def test_files_are_named_for_what_they_are(tmp_path, name, words):
    _files(tmp_path)
    assert words in kind_of_file(tmp_path / name)
    with pytest.raises(DataError, match=rf"is .*{words}.*, and no text of poses; "):
        read_trajectory(tmp_path / name)


def test_logs_of_ros_are_exported_first(tmp_path):
    _files(tmp_path)
    for name, reader in ("p.mcap", "bag2"), ("bag", "bag2"), ("p.bag", "bag"):
        with pytest.raises(
            DataError, match=rf"evo_traj {reader} {tmp_path / name} /odom --save_as_tum, and give the .tum$"
        ):
            read_trajectory(tmp_path / name)


def test_headings_follow_the_column_that_gives_them(tmp_path):
    rows = "x_m,y_m,z_m,heading_deg\n0,0,0,0\n0,0,0,90\n0,0,0,-90\n"
    found = read_trajectory(write(tmp_path, rows))
    assert np.rad2deg(heading_of(found.T_world_camera)) == pytest.approx([90, 0, 180])
    assert found.turn == ("heading_deg",)
