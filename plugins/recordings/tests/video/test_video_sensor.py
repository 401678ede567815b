"""The sensor `video`: its frames are a recording's, its own rendered twin comes back bit for bit, layouts of 360-degree cameras."""

import logging

import numpy as np
import pytest

from omnilab.api import GridPoses, RecordedPoses
from omnilab.cameras import DualFisheyeCamera, EquirectangularCamera, save_camera
from omnilab.errors import ConfigError, DataError
from omnilab.testing import check_sensor
from omnilab_recordings import Video
from omnilab_recordings.on_bad_image import OnBadImage
from omnilab_recordings.video.sensor import Clock

CIRCLE = [47.5, 31.5, 32.0]


def test_it_keeps_the_contract_of_sensors(write_video, pictures):
    file = write_video("a.mkv", pictures(9))
    check_sensor(Video(str(file), circle_px=CIRCLE, batch=4), RecordedPoses())
    check_sensor(Video(str(file), circle_px=CIRCLE, every=3, color=True), RecordedPoses())


def test_a_lossless_twin_is_read_bit_for_bit(write_video, pictures):
    images = pictures(9)
    sensor = Video(str(write_video("a.mkv", images)), circle_px=CIRCLE, batch=4)
    batches = list(sensor.frames(sensor.plan(RecordedPoses())))
    assert [len(batch) for batch in batches] == [4, 4, 1]
    assert np.array_equal(np.concatenate([batch.images for batch in batches]), images)
    assert np.array_equal(np.concatenate([batch.stamps_ns for batch in batches]), np.arange(9) * 50_000_000)
    assert batches[0].keys[1].startswith("a.mkv#1@")


def test_poses_of_another_file_are_those_at_the_frames_times(write_video, pictures, tmp_path):
    times_ms = [0, 40, 100, 300, 320]
    file = write_video("a.mkv", pictures(5), times_ms=times_ms)
    (tmp_path / "poses.csv").write_text("stamp_s,x_m,y_m\n" + "".join(f"{100 + t / 10},{t},0\n" for t in range(5)))
    sensor = Video(str(file), circle_px=CIRCLE, positions=str(tmp_path / "poses.csv"), clock_offset_s=-100)
    T = sensor.plan(RecordedPoses()).T_world_camera
    assert np.allclose(T[:, 0, 3], np.array(times_ms) / 100)
    late = Video(str(file), circle_px=CIRCLE, positions=str(tmp_path / "poses.csv"))
    with pytest.raises(DataError, match=r"sensor.clock_offset_s=-100.000"):
        late.plan(RecordedPoses())


def test_frames_since_1970_where_the_file_says_when_it_was_begun(write_video, pictures):
    h264 = {"codec": "libx264", "pix_fmt": "yuv420p", "options": {"x264-params": "log-level=none"}}
    dated = write_video("a.mp4", pictures(3), **h264, creation_time="2024-05-01T10:00:00Z")
    sensor = Video(str(dated), circle_px=CIRCLE, clock=Clock.created)
    (frames,) = sensor.frames(sensor.plan(RecordedPoses()))
    assert frames.stamps_ns.tolist() == [1714557600 * 10**9 + i * 50_000_000 for i in range(3)]
    undated = Video(str(write_video("b.mp4", pictures(3), **h264)), circle_px=CIRCLE, clock=Clock.created)
    with pytest.raises(ConfigError, match=r"does not say when it was begun; give sensor.clock=file"):
        undated.plan(RecordedPoses())


def test_damaged_frames_are_left_out_or_end_the_run(write_video, pictures, damage):
    file = write_video("a.avi", pictures(9), "mjpeg", "yuvj420p")
    damage(file, 4)
    sensor = Video(str(file), circle_px=CIRCLE)
    (frames,) = sensor.frames(sensor.plan(RecordedPoses()))
    assert frames.plan_index.tolist() == [0, 1, 2, 3, 5, 6, 7, 8]
    assert frames.omitted == ["a.avi#4, at 0.200 s, is damaged: nothing can be decoded"]
    strict = Video(str(file), circle_px=CIRCLE, on_bad_image=OnBadImage.fail)
    with pytest.raises(DataError, match=r"leave such images out with sensor.on_bad_image=skip"):
        list(strict.frames(strict.plan(RecordedPoses())))


def test_uneven_times_are_said_once(write_video, pictures, caplog):
    sensor = Video(str(write_video("a.mkv", pictures(4), times_ms=[0, 33, 66, 300])), circle_px=CIRCLE)
    with caplog.at_level(logging.WARNING, "omnilab"):
        list(sensor.frames(sensor.plan(RecordedPoses())))
    assert caplog.text.count("its frames are 33 to 234 ms apart, mostly 33: their times are those of the file") == 1


# -------------------------------------------------------------------------------------------------------------- layouts
def sky(camera):
    """A smooth world at infinity."""
    v, u = np.indices((camera.height, camera.width)).astype(float)
    x, y, z = np.moveaxis(camera.directions(np.stack([u, v], -1)), -1, 0)
    return np.nan_to_num(np.rint(128 + 60 * np.sin(2 * x + 1) * np.cos(3 * y) + 40 * z)).astype(np.uint8)


def test_two_fisheyes_are_declared_or_calibrated(write_video, tmp_path):
    camera = DualFisheyeCamera(
        width=200, height=100, front_px=(49.5, 49.5, 50.0), back_px=(149.5, 49.5, 50.0), back_rpy_deg=(2.0, 1.0, 179.0)
    )
    file = write_video("a.mkv", [sky(camera)] * 3)
    save_camera(camera, tmp_path / "camera.json")
    calibrated = Video(str(file), camera=str(tmp_path / "camera.json"))
    (frames,) = calibrated.frames(calibrated.plan(RecordedPoses()))
    assert frames.camera == camera
    declared = Video(str(file), panorama="dual_fisheye")
    (frames,) = declared.frames(declared.plan(RecordedPoses()))
    assert (frames.camera.fov_deg, frames.camera.front_px) == (190.0, (49.5, 49.5, 50.0))
    square = Video(str(write_video("b.mkv", [np.zeros((64, 64), np.uint8)] * 2)), panorama="dual_fisheye")
    with pytest.raises(DataError, match="64 x 64 pixels are no two circles side by side"):
        list(square.frames(square.plan(RecordedPoses())))


def test_panoramas_are_declared(write_video):
    file = write_video("a.mkv", [sky(EquirectangularCamera(128, 64, 180.0, True))] * 3)
    sensor = Video(str(file), panorama="equirectangular")
    (frames,) = sensor.frames(sensor.plan(RecordedPoses()))
    assert frames.camera == EquirectangularCamera(128, 64, 180.0, True)


def test_a_grid_is_not_in_a_video(write_video, pictures):
    with pytest.raises(DataError, match=r"a.mkv is a sequence of 3 images"):
        Video(str(write_video("a.mkv", pictures(3))), circle_px=CIRCLE).plan(GridPoses(step_m=1))
