"""Images that come with a calibration, and poses with six degrees of freedom."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnilab.api import RecordedPoses
from omnilab.cameras import (
    CylindricalCamera,
    HyperbolicMirror,
    ImageCircle,
    OCamCamera,
    UnifiedCamera,
    save_camera,
)
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import heading_of, poses, quaternion_xyzw, rotation_xyz, wrap_angle
from omnilab.image import mirror_view, panorama
from omnilab.trajectory.files import kitti_text
from omnilab.trajectory.tables import read_table
from omnilab_recordings import Folder
from omnilab_recordings.folder import OnBadImage
from omnilab_recordings.poses.positions import positions_in
from omnilab_recordings.poses.trajectory_poses import poses_of_images

DATA = Path(__file__).resolve().parents[4] / "shared" / "data"
AMIENS = UnifiedCamera(
    width=1600, height=1200, cx=692.86729, cy=572.11922, fx=425.19303, fy=424.86463, xi=0.98754, rim_px=495, inner_px=75
)
SMALL = UnifiedCamera(width=60, height=50, cx=31, cy=24, fx=15, fy=15.2, xi=0.97, skew=0.1, rim_px=22)
OCAM = """#polynomial coefficients for the DIRECT mapping function
4 -15.0 0.0 2.2e-2 1e-4
#polynomial coefficients for the inverse mapping function
2 1.0 1.0
#center: "row" and "column", starting from 0
24.5 30.5
#affine parameters "c", "d", "e"
1.0 0.001 -0.002
#image size: "height" and "width"
50 60
"""


def read_all(sensor):
    (frames,) = sensor.frames(sensor.plan(RecordedPoses()))
    return frames


@pytest.fixture
def small(write_recording):
    rng = np.random.default_rng(0)
    return write_recording([rng.integers(0, 255, (50, 60), dtype=np.uint8) for _ in range(2)])


# --------------------------------------------------------------------------------------------------------- the camera
def test_a_camera_beside_the_images_is_theirs(small):
    assert isinstance(read_all(Folder(small)).camera, ImageCircle)
    save_camera(SMALL, small / "camera.json")
    assert read_all(Folder(small)).camera == SMALL
    assert read_all(Folder(small, mirrored=True)).camera == SMALL.flipped()


@pytest.mark.parametrize("place", ["calibration/mine.json", "../mine.json"])
def test_a_camera_that_is_named(small, place):
    (small / place).parent.mkdir(exist_ok=True)
    save_camera(SMALL, small / place)
    assert read_all(Folder(small, camera=place)).camera == SMALL
    assert read_all(Folder(small, camera=str((small / place).resolve()))).camera == SMALL


@pytest.mark.parametrize(("looks", "z"), [(None, -1), ("down", -1), ("up", 1)])
def test_a_calibration_of_ocamcalib(small, looks, z):
    (small / "calib_results.txt").write_text(OCAM)
    camera = read_all(Folder(small, camera="calib_results.txt", looks=looks)).camera
    assert camera == OCamCamera.from_file(small / "calib_results.txt", looks=looks or "down")
    assert camera.directions(np.array([30.5, 24.5])) == pytest.approx([0, 0, z])


@pytest.mark.parametrize("camera", [SMALL, HyperbolicMirror(size=50, margin_px=5), CylindricalCamera(60, 50, 20.0)])
def test_flipped_pictures_show_the_same_panorama_turned_round(small, camera):
    # the flip takes azimuth a to 180 degrees - a: columns j to (columns / 2 - j) of the panorama
    save_camera(camera, small / "camera.json")
    plain, flipped = read_all(Folder(small)), read_all(Folder(small, mirrored=True))
    first, second = (panorama(part.images, part.camera, (20, 64)).astype(float) for part in (plain, flipped))
    assert np.abs(second - first[:, :, (32 - np.arange(64)) % 64]).max() < 5


def test_blanks_are_off_the_camera_s_ring(small):
    save_camera(SMALL, small / "camera.json")
    image = read_all(Folder(small, blank_outside=True)).images[0]
    v, u = np.indices(image.shape)
    assert (image[np.hypot(u - 31, v - 24) > 23.5] == 0).all()
    save_camera(CylindricalCamera(60, 50), small / "camera.json")
    with pytest.raises(ConfigError, match="blank_outside=true, but this camera has no image circle"):
        read_all(Folder(small, blank_outside=True))


@pytest.mark.parametrize(("settings", "error", "sentence"), [
    ({"camera": "none.json"}, DataError, r"none\.json cannot be read"),
    ({"circle_px": [30, 25, 20]}, ConfigError, r"circle_px or sky_inside is given, but the camera in .*camera\.json knows"),
    ({"sky_inside": True}, ConfigError, r"sky_inside"),
    ({"looks": "up"}, ConfigError, r"looks='up' is given, but .*camera\.json says itself"),
    ({"camera": "calib.txt", "looks": "left"}, DataError, r"'left' is not known; a camera looks 'down'"),
])  # fmt: skip
def test_cameras_that_cannot_be_meant(small, settings, error, sentence):
    save_camera(SMALL, small / "camera.json")
    (small / "calib.txt").write_text(OCAM)
    with pytest.raises(error, match=sentence):
        read_all(Folder(small, **settings))


def test_looks_without_a_camera(small):
    with pytest.raises(ConfigError, match=r"without a camera; give sensor\.camera=FILE"):
        read_all(Folder(small, looks="up"))


def test_a_camera_of_other_images(small):
    save_camera(AMIENS, small / "camera.json")
    with pytest.raises(DataError, match=r"is of images of 1600 x 1200 pixels, these have 60 x 50"):
        read_all(Folder(small))


# ------------------------------------------------------------------------------------------- two published mirror images
def heights_deg(first, second, turn_deg, camera, sectors=8):
    """How much higher the second panorama shows the same things than the first, in each sector."""
    rows, columns = first.shape
    first = np.roll(first, -round(turn_deg * columns / 360), axis=1)
    window = cv2.createHanningWindow((columns // sectors, rows), cv2.CV_32F)
    pairs = zip(np.split(first, sectors, 1), np.split(second, sectors, 1), strict=True)
    up = [cv2.phaseCorrelate(np.ascontiguousarray(a), np.ascontiguousarray(b), window)[0][1] for a, b in pairs]
    return np.array(up) * (60 + np.rad2deg(camera.elevations_rad[1])) / rows


@pytest.mark.parametrize("mirrored", [False, True])
def test_the_amiens_mirror_turns_by_what_was_published(tmp_path, mirrored):
    if not (DATA / "amiens_catadioptric").is_dir():
        pytest.skip(f"the published pictures are not in {DATA}")
    appearance = pytest.importorskip("omnilab_appearance")
    save_camera(AMIENS, tmp_path / "amiens.json")
    folder = str(DATA / "amiens_catadioptric")
    frames = read_all(Folder(folder, pattern="*T0.pgm", camera=str(tmp_path / "amiens.json"), mirrored=mirrored))
    signatures = appearance.Radon().describe(mirror_view(frames.images, frames.camera))
    index = appearance.PocBand().prepare(signatures[:1])
    turn_deg = np.rad2deg(appearance.PocBand().match(signatures[1:], index).rotation_rad[0, 0])
    assert turn_deg == pytest.approx(46.5 if mirrored else -46.5, abs=1.5)  # the camera looks up into its mirror
    first, second = panorama(frames.images, frames.camera, (180, 720)).astype(np.float32)
    assert np.abs(heights_deg(first, second, turn_deg, frames.camera)).max() < 1.0


# ------------------------------------------------------------------------------------------------------------ the poses
angles = st.tuples(*[st.floats(-180, 180)] * 3)


def poses_of(path, header, values):
    file = path / "positions.csv"
    file.write_text(f"image,x_m,y_m,z_m,{header}\na.png,0.1,0.2,0.3,{','.join(map(repr, map(float, values)))}\n")
    return positions_in(read_table(file)).R_world_robot[0]


@given(angles)
def test_rotations_in_every_notation(tmp_path_factory, degrees):
    path = tmp_path_factory.mktemp("poses")
    R = rotation_xyz(*np.deg2rad(degrees))
    assert np.array_equal(poses_of(path, ",".join(f"r{i}{j}" for i in range(3) for j in range(3)), R.ravel()), R)
    assert np.allclose(poses_of(path, "qx,qy,qz,qw", 2 * quaternion_xyzw(R)), R, atol=1e-12)
    assert np.allclose(poses_of(path, "rx_deg,ry_deg,rz_deg", degrees), R, atol=1e-12)
    assert heading_of(poses_of(path, "yaw_deg", degrees[:1])) == pytest.approx(
        wrap_angle(np.deg2rad(degrees[0])), abs=1e-9
    ) or abs(degrees[0]) == pytest.approx(180)


def test_a_rendered_data_set_comes_back_bit_for_bit(tmp_path):
    rng = np.random.default_rng(3)
    R = rotation_xyz(*rng.uniform(-3, 3, (3, 4)))
    position_m = rng.normal(size=(4, 3))
    images = rng.integers(0, 255, (4, 50, 60), dtype=np.uint8)
    (tmp_path / "images").mkdir()
    cells = [f"r{i}{j}" for i in range(3) for j in range(3)]
    lines = [",".join(["image", "x_m", "y_m", "z_m", *cells, "yaw_deg", "stamp_ns", "key", "ix", "iy"])]
    for i in range(4):
        cv2.imwrite(str(tmp_path / f"images/{i:06d}.png"), images[i])
        numbers = [*position_m[i], *R[i].ravel(), np.rad2deg(heading_of(R[i]))]
        lines.append(
            ",".join([f"images/{i:06d}.png", *(repr(float(x)) for x in numbers), str(7 * i), f"k{i}", str(i), "0"])
        )
    (tmp_path / "positions.csv").write_text("\n".join(lines) + "\n")
    save_camera(SMALL, tmp_path / "camera.json")
    frames = read_all(Folder(str(tmp_path)))
    assert np.array_equal(frames.images, images)
    assert np.array_equal(frames.T_world_camera[:, :3, :3], R)
    assert np.array_equal(frames.T_world_camera[:, :3, 3], position_m)
    assert frames.camera == SMALL
    assert frames.stamps_ns.tolist() == [0, 7, 14, 21]


@pytest.fixture
def with_depth(tmp_path):
    """Two images below images/, and their depths (2, 16, 20)."""
    depths = np.random.default_rng(1).uniform(0, 9, (2, 16, 20)).astype(np.float32)
    depths[0, 3, 4] = np.inf
    for name in "images", "depth":
        (tmp_path / name).mkdir()
    for i, depth in enumerate(depths):
        cv2.imwrite(str(tmp_path / f"images/{i}.png"), np.full((16, 20), 90, np.uint8))
        np.save(tmp_path / f"depth/{i}.npy", depth)
    return Folder(str(tmp_path), circle_px=[9, 8, 7], depth=True), depths


def test_depth_comes_along(with_depth):
    sensor, depths = with_depth
    assert np.array_equal(read_all(sensor).depth_m, depths)
    assert np.array_equal(read_all(replace(sensor, mirrored=True)).depth_m, depths[:, :, ::-1])
    assert read_all(replace(sensor, depth=False)).depth_m is None


@pytest.mark.parametrize(("damage", "sentence"), [
    (lambda file: file.unlink(), r"^depth/1\.npy cannot be read"),
    (lambda file: file.write_bytes(b"text"), r"depth/1\.npy is no depth of images/1\.png"),
    (lambda file: file.write_bytes(file.read_bytes()[:-8]), r"depth/1\.npy is no depth"),
    (lambda file: np.save(file, np.zeros((16, 21), np.float32)), r"float32 \(16, 20\) \(it holds float32 \(16, 21\)\)"),
    (lambda file: np.save(file, np.zeros((16, 20))), r"it holds float64"),
    (lambda file: np.save(file, np.array([{"an": "object"}]), allow_pickle=True), r"of object"),
])  # fmt: skip
def test_depth_that_is_none(with_depth, damage, sentence):
    sensor, _ = with_depth
    damage(Path(sensor.path) / "depth/1.npy")
    with pytest.raises(DataError, match=sentence):
        read_all(sensor)
    assert len(read_all(replace(sensor, on_bad_image=OnBadImage.skip))) == 1


def test_turned_deg_turns_about_the_camera_s_own_axis(write_recording):
    rows = ["img-0.png,0,0,30,-20,110"]
    root = write_recording([np.zeros((16, 16), np.uint8)], rows, "image,x_m,y_m,rx_deg,ry_deg,rz_deg")
    T = Folder(root, turned_deg=40).plan(RecordedPoses()).T_world_camera[0]
    assert np.allclose(T[:3, :3], rotation_xyz(*np.deg2rad([30, -20, 70])))


@pytest.mark.parametrize(("header", "row", "sentence"), [
    ("qx,qy,qz,qw", "0,0,0,0", r"line 2 .* no unit quaternion"),
    ("qx,qy,qz", "0,0,0", r"lacks qw; give all of qx, qy, qz, qw, or none"),
    ("r00,r01,r02,r10,r11,r12,r20,r21,r22", "1,0,0,0,1,0,0,0,-1", r"line 2 .* has r00 to r22 = .* no rotation matrix"),
    ("r00,r01,r02,r10,r11,r12,r20,r21,r22", "1,0,0,0,1,0,0,0.1,1", r"line 2 .* no rotation matrix"),
])  # fmt: skip
def test_rotations_that_are_none(write_recording, header, row, sentence):
    root = write_recording([np.zeros((16, 16), np.uint8)], [f"img-0.png,0,0,{row}"], f"image,x_m,y_m,{header}")
    with pytest.raises(DataError, match=sentence):
        Folder(root).plan(RecordedPoses())


# ------------------------------------------------------------------------------------------------------- trajectories
@pytest.fixture
def write_tum(tmp_path):
    def write(names, lines):
        for name in names:
            cv2.imwrite(str(tmp_path / name), np.full((16, 16), 90, np.uint8))
        (tmp_path / "poses.tum").write_text("\n".join(["# a comment", "", *lines]) + "\n")
        return Folder(str(tmp_path), positions="poses.tum", circle_px=[8, 8, 7])

    return write


def test_a_trajectory_goes_with_images_in_their_order(write_tum):
    q = quaternion_xyzw(rotation_xyz(0.3, -0.2, 2.0))
    lines = [f"{t}.5 {t} 0.25 1e-1 {' '.join(map(repr, map(float, q)))}" for t in range(11)]
    frames = read_all(write_tum([f"{i}.png" for i in range(11)], lines))
    assert frames.T_world_camera[:, :3, 3].tolist() == [[t, 0.25, 0.1] for t in range(11)]
    assert np.allclose(frames.T_world_camera[:, :3, :3], rotation_xyz(0.3, -0.2, 2.0))
    assert frames.stamps_ns.tolist() == [t * 10**9 + 5 * 10**8 for t in range(11)]


@given(st.lists(st.integers(0, 10**6), min_size=1, max_size=30, unique=True), st.integers(-19, 19), st.randoms())
def test_a_trajectory_goes_with_stamps_in_names(tmp_path_factory, ticks, off_ms, shuffle):
    file = tmp_path_factory.mktemp("tum") / "poses.txt"
    stamps_ms = [10**6 + 100 * tick for tick in ticks]
    lines = [f"{ms / 1000:.3f} {ms} 0 0 0 0 0 1" for ms in stamps_ms]
    shuffle.shuffle(lines)
    file.write_text("\n".join(lines))
    found = poses_of_images(read_table(file), [f"{(ms + off_ms) / 1000:.6f}.png" for ms in stamps_ms])
    assert found.position_m[:, 0].tolist() == stamps_ms


def test_a_table_is_read_by_what_it_holds(write_tum, tmp_path):
    sensor = write_tum(["b.png", "a.png"], [])
    (tmp_path / "poses.txt").write_text("image,x_m,y_m\nb.png,1,2\na.png,3,4\n")
    plan = replace(sensor, positions="poses.txt").plan(RecordedPoses())
    assert plan.keys == ["b.png", "a.png"]  # by their names, not in their order
    (tmp_path / "positions.csv").write_text("0 1 2 3 0 0 0 1\n1 4 5 6 0 0 0 1\n")
    assert replace(sensor, positions="positions.csv").plan(RecordedPoses()).T_world_camera[:, 0, 3].tolist() == [1, 4]
    (tmp_path / "bag").mkdir()
    with pytest.raises(DataError, match=r"bag is a folder, and no text of poses"):
        replace(sensor, positions="bag").plan(RecordedPoses())


@pytest.mark.parametrize("name", ["1700000000600000000", "1700000000600000", "1700000000600", "1700000000.6"])
def test_names_may_be_times_in_any_unit(write_tum, name):
    lines = [f"170000000{t} {t} 0 0 0 0 0 1" for t in ("0.5", "0.6", "0.7")]
    assert write_tum([f"{name}.png"], lines).plan(RecordedPoses()).T_world_camera[0, 0, 3] == 0.6


def test_a_trajectory_of_kitti_goes_with_images_in_their_order(write_tum, tmp_path):
    T = poses([[1, 2, 3], [4, 5, 6]], rotation_xyz(0.3, -0.2, [2.0, 1.0]))
    (tmp_path / "poses.kitti").write_text(kitti_text(T))
    sensor = replace(write_tum(["a.png", "b.png"], []), positions="poses.kitti")
    assert np.array_equal(sensor.plan(RecordedPoses()).T_world_camera, T)
    with pytest.raises(DataError, match=r"has 2 poses for 3 images; give as many \(it holds no times\)"):
        replace(write_tum(["c.png"], []), positions="poses.kitti").plan(RecordedPoses())


@pytest.mark.parametrize(("names", "lines", "sentence"), [
    (["a.png"], ["0 1 2 3 0 0 0"], r"line 3 of .* has 7 values for 8 columns; write t tx ty"),
    (["a.png"], ["0 1 2 nan 0 0 0 1"], r"line 3 of"),
    (["a.png"], ["0 1 2 3 0 0 0 0"], r"line 3 of"),
    (["a.png"], [], r"holds no pose; write one in each line"),
    (["a.png", "b.png"], ["0 1 2 3 0 0 0 1"], r"has 1 poses for 2 images; .*by their stamps"),
    (["1.00.png", "2.50.png"], ["1700000000 1 2 3 0 0 0 1", "1700000009 1 2 3 0 0 0 1"], r"named by times of 1\.000 s to 2\.500 s, and .*poses\.tum covers 1700000000\.000 s \(2023"),
    (["1700000000500000000.png"], ["1700000000.5 1 2 3 0 0 0 1", "1700000000.6 1 2 x 0 0 0 1"], r"line 4 of .* has tz='x'"),
    (["1600000000500.png"], ["1700000000.5 1 2 3 0 0 0 1", "1700000000.6 1 2 3 0 0 0 1"], r"named by times of 1600000000\.500 s .* 1700000000"),
    (["1.00.png", "2.50.png"], ["1.01 1 2 3 0 0 0 1"], r"no pose within 0\.02 s of 1 of 2 images, 2\.50\.png say"),
])  # fmt: skip
def test_trajectories_that_do_not_fit(write_tum, names, lines, sentence):
    with pytest.raises(DataError, match=sentence):
        write_tum(names, lines).plan(RecordedPoses())
