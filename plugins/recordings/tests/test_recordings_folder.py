"""What the folder sensor delivers: layouts, poses, pixels, keys."""

from __future__ import annotations

import pickle
import subprocess
import sys

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from omegaconf import OmegaConf
from omegaconf.errors import MissingMandatoryValue

from omnilab.api import GridPoses, RecordedPoses, Sensor
from omnilab.errors import DataError
from omnilab.geometry import heading_of, wrap_angle
from omnilab.image import panorama
from omnilab_recordings import Folder
from omnilab_recordings.folder import OnBadImage
from omnilab_recordings.images.order import in_order


def numbers(plan):
    return [int(key.split("-")[1].split(".")[0]) for key in plan.keys]


def all_images(sensor):
    return np.concatenate([frames.images for frames in sensor.frames(sensor.plan(RecordedPoses()))])


def test_every_second_row_and_column(write_grid):
    sensor = Folder(write_grid(5, 4))
    assert numbers(sensor.plan(GridPoses(every=2))) == [0, 2, 4, 10, 12, 14]


def test_step_is_a_multiple_of_the_recorded_spacing(write_grid):
    sensor = Folder(write_grid(5, 4, step_m=0.5))
    assert numbers(sensor.plan(GridPoses(step_m=1.5))) == [0, 3, 15, 18]
    assert sensor.plan(GridPoses(step_m=1.0)).keys == sensor.plan(GridPoses(every=2)).keys


def test_extent_lies_around_the_origin(write_grid):
    plan = Folder(write_grid(5, 4, step_m=0.5)).plan(GridPoses(step_m=0.5, extent_m=(2.0, 1.0)))
    assert numbers(plan) == [0, 1, 2, 5, 6, 7]


def test_height_selects_among_recorded_heights(write_recording):
    rows = [f"img-{i}.png,{i % 2},0,{0.5 * (i // 2)}" for i in range(6)]
    sensor = Folder(write_recording([np.zeros((9, 9), np.uint8)] * 6, rows, "image,x_m,y_m,z_m"))
    plan = sensor.plan(GridPoses(every=1, height_m=0.5))
    assert numbers(plan) == [2, 3]
    assert plan.T_world_camera[:, 2, 3] == pytest.approx(0.5)


@pytest.mark.parametrize(
    "grid", [GridPoses(every=2), GridPoses(every=3), GridPoses(step_m=2.0), GridPoses(every=2, extent_m=(2.0, 2.0))]
)
def test_places_and_rest_are_all_that_was_recorded(write_grid, grid):
    sensor = Folder(write_grid(5, 4))
    places, rest = numbers(sensor.plan(grid)), numbers(sensor.plan(RecordedPoses(without=grid)))
    assert not set(places) & set(rest)
    assert sorted(places + rest) == numbers(sensor.plan(RecordedPoses())) == list(range(20))
    assert rest == sorted(rest)


def test_columns_ix_and_iy_rule_over_coordinates(write_recording):
    # a grid that is turned by 30 degrees: x and y alone do not show it
    turn = np.exp(1j * np.pi / 6)
    rows = [
        f"img-{i}.png,{z.real:.6f},{z.imag:.6f},{i % 3},{i // 3}"
        for i in range(9)
        for z in [0.4 * turn * complex(i % 3, i // 3)]
    ]
    sensor = Folder(write_recording([np.zeros((9, 9), np.uint8)] * 9, rows, "image,x_m,y_m,ix,iy"))
    assert numbers(sensor.plan(GridPoses(step_m=0.8))) == [0, 2, 6, 8]


def test_poses_hold_position_and_heading(write_recording):
    rows = ["img-0.png,1.5,-2,0.3,90", "img-1.png,0,0,0,-45"]
    sensor = Folder(write_recording([np.zeros((9, 9), np.uint8)] * 2, rows, "image,x_m,y_m,z_m,yaw_deg"))
    T = sensor.plan(RecordedPoses()).T_world_camera
    assert T[0] == pytest.approx(np.array([[0, -1, 0, 1.5], [1, 0, 0, -2], [0, 0, 1, 0.3], [0, 0, 0, 1]]), abs=1e-12)
    assert heading_of(T) == pytest.approx(np.deg2rad([90, -45]))


def test_without_positions_names_are_in_numerical_order(write_recording):
    sensor = Folder(write_recording([np.full((9, 9), i, np.uint8) for i in range(12)]))
    plan = sensor.plan(RecordedPoses())
    assert numbers(plan) == list(range(12))
    assert plan.T_world_camera is None
    (frames,) = sensor.frames(plan.at([3, 11]))
    assert frames.T_world_camera is None
    assert frames.images[:, 0, 0].tolist() == [3, 11]
    assert frames.stamps_ns.tolist() == [300_000_000, 1_100_000_000]


@pytest.mark.parametrize("names", [
    ["1000.0", "1000.05", "1000.1", "1000.15", "1000.2", "1000.95", "1001.0"],  # seconds as Python prints them
    ["999.95", "1000.05", "1000.10", "1000.20"],
    ["1.1", "1.9", "1.10", "1.11"],  # the ninth, the tenth
    ["a_0.25_left", "a_0.5_left", "a_0.75_left"], ["v1.2.9", "v1.2.10", "v1.10.1"], ["1", "2", "10"],
    ["run2_3.5", "run10_0.25"],
])  # fmt: skip
def test_names_with_numbers_are_in_their_order(names):
    files = [f"{name}.png" for name in names]
    for start in range(len(files)):
        assert in_order(files[start:] + files[:start]) == files


@given(st.lists(st.integers(0, 10**5), min_size=1, max_size=20, unique=True), st.sampled_from([10, 100, 1000]))
def test_times_as_python_prints_them_are_in_order(ticks, per_second):
    times = sorted(tick / per_second for tick in ticks)
    assert in_order(f"{time}.png" for time in reversed(times)) == [f"{time}.png" for time in times]


def test_a_log_is_no_folder(tmp_path):
    (tmp_path / "run.mcap").write_bytes(b"\x89MCAP0\r\n")
    with pytest.raises(DataError, match=r"is an MCAP log, no folder of images; export its images .*evo_traj bag2"):
        Folder(str(tmp_path / "run.mcap")).plan(RecordedPoses())
    (tmp_path / "a.png").write_bytes(b"\x89PNG")
    with pytest.raises(DataError, match=r"is a PNG picture, no folder of images; give sensor\.path=DIR"):
        Folder(str(tmp_path / "a.png")).plan(RecordedPoses())


def test_recorded_stamps(write_recording):
    rows = ["img-0.png,0,0,1700000000000000001", "img-1.png,1,0,1700000000500000002"]
    sensor = Folder(write_recording([np.zeros((9, 9), np.uint8)] * 2, rows, "image,x_m,y_m,stamp_ns"))
    (frames,) = sensor.frames(sensor.plan(RecordedPoses()))
    assert frames.stamps_ns.dtype == np.int64
    assert frames.stamps_ns.tolist() == [1700000000000000001, 1700000000500000002]


def test_positions_tolerate_a_byte_order_mark_and_other_columns(write_recording):
    root = write_recording([np.zeros((9, 9), np.uint8)] * 2)
    text = '\ufeffimage, note ,x_m,y_m\r\n./img-0.png,"a, b",0,1\r\n\r\nimg-1.png,,2,3\r\n'
    (root / "positions.csv").write_text(text, encoding="utf-8", newline="")
    plan = Folder(root).plan(RecordedPoses())
    assert plan.T_world_camera[:, :2, 3].tolist() == [[0, 1], [2, 3]]
    assert plan.keys == ["img-0.png", "img-1.png"]


@pytest.mark.parametrize(("mirrored", "turned_deg", "yaw_deg", "bearing_deg"), [
    (False, 0, 0, 40), (False, 90, 0, 40), (False, -30, 75, 200), (True, 0, 0, 40), (True, 90, 0, 40), (True, 150, -60, 310),
])  # fmt: skip
def test_a_bright_spot_is_seen_where_it_is(write_recording, mirrored, turned_deg, yaw_deg, bearing_deg):
    # a robot with heading yaw sees the spot at bearing - yaw; its front is at azimuth turned in the picture
    azimuth = np.deg2rad(bearing_deg - yaw_deg + turned_deg)
    image = np.zeros((201, 241), np.uint8)
    cx, cy, radius = 130.0, 95.0, 80.0
    spot = (round(cx + 50 * np.cos(azimuth)), round(cy - 50 * np.sin(azimuth)))
    cv2.circle(image, spot, 3, 255, -1)
    if mirrored:
        image, cx = np.ascontiguousarray(image[:, ::-1]), 240 - cx
    root = write_recording([image], [f"img-0.png,0,0,{yaw_deg}"], "image,x_m,y_m,yaw_deg")

    sensor = Folder(root, circle_px=[cx, cy, radius], mirrored=mirrored, turned_deg=turned_deg)
    (frames,) = sensor.frames(sensor.plan(RecordedPoses()))

    columns = panorama(frames.images, frames.camera, (64, 720))[0].sum(0, dtype=float)
    seen = np.angle((columns * np.exp(2j * np.pi * np.arange(720) / 720)).sum())
    bearing = seen + heading_of(frames.T_world_camera[0])
    assert abs(np.rad2deg(wrap_angle(bearing - np.deg2rad(bearing_deg)))) < 1.0


def picture(seed=0, shape=(30, 40, 3)):
    noise = np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)
    return cv2.GaussianBlur(noise, (9, 9), 3)


def test_colour_is_rgb_and_png_is_exact(write_recording):
    bgr = picture()
    root = write_recording([bgr])
    assert np.array_equal(all_images(Folder(root, color=True))[0], bgr[:, :, ::-1])
    grey = all_images(Folder(root))[0]
    assert np.abs(grey - bgr @ np.array([0.114, 0.587, 0.299])).max() <= 1


def test_grey_files_as_colour(write_recording):
    grey = picture()[:, :, 0]
    assert np.array_equal(all_images(Folder(write_recording([grey]), color=True))[0], np.dstack([grey] * 3))


def test_jpeg_comes_close(write_recording):
    grey = picture()[:, :, 0]
    assert np.abs(all_images(Folder(write_recording([grey], ending="jpg")))[0].astype(int) - grey).mean() < 2


def test_mask_blanks_and_is_no_image_of_the_recording(write_recording):
    grey = picture()[:, :, 0] // 2 + 50
    root = write_recording([grey, grey])
    mask = np.full(grey.shape, 255, np.uint8)
    mask[:10, :15] = 0
    cv2.imwrite(str(root / "mask.png"), mask)
    images = all_images(Folder(root, mask="mask.png", mirrored=True))
    assert len(images) == 2
    assert np.array_equal(images[0], np.where(mask > 0, grey, 0)[:, ::-1])


def test_outside_the_ring_can_be_blanked(write_recording):
    root = write_recording([np.full((60, 60), 200, np.uint8)])
    image = all_images(Folder(root, circle_px=[30, 28, 20, 8], blank_outside=True))[0]
    v, u = np.indices(image.shape)
    distance = np.hypot(u - 30, v - 28)
    assert (image[(distance <= 20) & (distance >= 8)] == 200).all()
    assert (image[(distance > 22) | (distance < 6)] == 0).all()


def test_keys_tell_content_and_settings(write_grid):
    root = write_grid(2, 2)
    circle = [12.0, 10.0, 8.0]

    def keys(**settings):
        sensor = Folder(root, circle_px=circle, **settings)
        (frames,) = sensor.frames(sensor.plan(RecordedPoses()))
        return tuple(frames.keys)

    plain = keys()
    assert len(set(plain)) == 4
    assert all(key.startswith(f"img-{i}.png@") for i, key in enumerate(plain))
    assert plain == keys(turned_deg=30, sky_inside=True)
    assert len({plain, keys(color=True), keys(mirrored=True), keys(blank_outside=True)}) == 4
    (root / "img-2.png").write_bytes((root / "img-3.png").read_bytes())
    assert [before == after for before, after in zip(plain, keys(), strict=True)] == [True, True, False, True]


@pytest.mark.parametrize("batch", [1, 3, 64])
def test_batches_keep_the_order_of_the_plan(write_grid, batch):
    sensor = Folder(write_grid(5, 4), batch=batch)
    plan = sensor.plan(RecordedPoses()).at([7, 0, 19, 3, 3])
    frames = list(sensor.frames(plan))
    assert [len(part) for part in frames] == [min(batch, 5 - at) for at in range(0, 5, batch)]
    assert np.concatenate([part.images for part in frames])[:, 0, 0].tolist() == [17, 10, 29, 13, 13]
    assert np.concatenate([part.plan_index for part in frames]).tolist() == list(range(5))
    assert np.array_equal(np.concatenate([part.T_world_camera for part in frames]), plan.T_world_camera)


def test_an_unfinished_reading_can_be_dropped(write_grid):
    reading = Folder(write_grid(5, 4), batch=2).frames(Folder(write_grid(5, 4)).plan(RecordedPoses()))
    assert len(next(reading)) == 2
    reading.close()


def test_skipped_files_are_reported_and_the_rest_is_complete(write_grid):
    root = write_grid(5, 4)
    for bad in (0, 7, 8, 19):
        (root / f"img-{bad}.png").write_bytes((root / f"img-{bad}.png").read_bytes()[:40])
    sensor = Folder(root, on_bad_image=OnBadImage.skip, batch=3)
    frames = list(sensor.frames(sensor.plan(RecordedPoses())))
    omitted = [reason.split()[0] for part in frames for reason in part.omitted]
    assert omitted == ["img-0.png", "img-7.png", "img-8.png", "img-19.png"]
    delivered = np.concatenate([part.images for part in frames])[:, 0, 0]
    assert delivered.tolist() == [10 + i for i in range(20) if i not in {0, 7, 8, 19}]
    assert np.array_equal(np.concatenate([part.plan_index for part in frames]), delivered - 10)
    x_m = np.concatenate([part.T_world_camera for part in frames])[:, 0, 3]
    assert x_m == pytest.approx(0.5 * ((delivered - 10) % 5))


def test_it_is_a_sensor_that_travels_and_is_configured(write_grid):
    root = write_grid(2, 2)
    node = OmegaConf.structured(Folder)
    with pytest.raises(MissingMandatoryValue, match="path"):
        OmegaConf.to_object(node)
    settings = OmegaConf.from_dotlist([f"path={root}", "on_bad_image=skip", "circle_px=[10,10,5]", "positions=null"])
    sensor = OmegaConf.to_object(OmegaConf.merge(node, settings))
    assert sensor == Folder(str(root), positions=None, circle_px=[10.0, 10.0, 5.0], on_bad_image=OnBadImage.skip)
    assert isinstance(sensor, Sensor)
    assert pickle.loads(pickle.dumps(sensor)) == sensor
    assert len(sensor.plan(RecordedPoses())) == 4
    assert pickle.loads(pickle.dumps(sensor)).plan(RecordedPoses()).keys == sensor.plan(RecordedPoses()).keys
    assert sensor.scene() is None


def test_importing_is_light():
    heavy = "print([name for name in ('cv2', 'scipy', 'numba', 'rerun') if name in sys.modules])"
    shown = subprocess.run(
        [sys.executable, "-c", f"import sys, omnilab_recordings; {heavy}"], capture_output=True, check=True
    )
    assert shown.stdout.strip() == b"[]"
