"""What all sensors of streams do, on a stream in memory: which images, their pixels, poses and clocks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from omnilab.api import Bytes, GridPoses, Ints, RecordedPoses
from omnilab.cameras import EquirectangularCamera, PinholeCamera, RayCamera, save_camera
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import heading_of, planar_poses, poses
from omnilab.testing import check_sensor
from omnilab.trajectory.files import Trajectory, tum_text
from omnilab_recordings.on_bad_image import OnBadImage
from omnilab_recordings.streams.sensor import StreamSensor

SIZE = (24, 96)
BEGIN_NS = 1_700_000_000_123_456_789


@dataclass
class MemoryStream:
    """Images of an array; a text in place of one is why it cannot be read."""

    images: list[Bytes | str]
    stamps_ns: Ints
    camera: RayCamera | None = None
    poses: Trajectory | None = None
    name: str = "memory"
    remarks: Mapping[str, str] = field(default_factory=dict)

    def pictures(self, rows: Ints) -> Iterator[Bytes | str]:
        for row in rows.tolist():
            image = self.images[row]
            yield image if isinstance(image, str) else image.copy()


@dataclass
class Memory(StreamSensor):
    """A stream in memory, for tests."""

    path: str = "memory"
    held: ClassVar[dict[str, MemoryStream]] = {}

    def open_stream(self) -> MemoryStream:
        return self.held[self.path]


def held(count: int = 10, step_s: float = 0.1, name: str = "memory", **known: Any) -> MemoryStream:
    """A stream of random images, `step_s` apart."""
    rng = np.random.default_rng(3)
    images = list(rng.integers(0, 255, (count, *SIZE), np.uint8))
    stamps = BEGIN_NS + np.arange(count) * round(step_s * 1e9)
    Memory.held[name] = MemoryStream(images, stamps, name=name, **known)
    return Memory.held[name]


def turning(count: int, step_s: float, begin_ns: int = BEGIN_NS) -> tuple[MemoryStream, np.ndarray]:
    """Panoramas of one place by a camera that turns to and fro as a robot does, and its headings."""
    held(count, step_s)
    rng = np.random.default_rng(8)
    width = SIZE[1]
    world = np.kron(rng.integers(0, 255, (SIZE[0] // 4, width // 4)), np.ones((4, 4)))
    time = np.arange(count) * step_s
    rates = np.convolve(rng.normal(0, 1.2, count) * (rng.random(count) < 0.3), np.hanning(9), "same")
    heading = np.cumsum(rates) * step_s
    columns = np.arange(width)
    images = [
        np.stack(
            [
                np.interp((columns - h * width / (2 * np.pi)) % width, np.arange(width + 1), np.r_[r, r[:1]])
                for r in world
            ]
        )
        for h in heading
    ]  # azimuth runs clockwise in a panorama: what is straight ahead moves to the right when the camera turns left
    stream = Memory.held["memory"] = MemoryStream(
        [i.astype(np.uint8) for i in images], begin_ns + (time * 1e9).astype(np.int64)
    )
    return stream, heading


def write_poses(file: Path, T: np.ndarray, stamps_ns: np.ndarray) -> str:
    file.write_text(tum_text(T, stamps_ns))
    return str(file)


def taken(sensor: StreamSensor) -> np.ndarray:
    return np.concatenate([frames.images for frames in sensor.frames(sensor.plan(RecordedPoses()))])


# ------------------------------------------------------------------------------------------------------------- which
def test_it_keeps_the_contract_of_sensors() -> None:
    stream = held(7, poses=Trajectory(planar_poses(np.zeros((7, 3))), BEGIN_NS + np.arange(7) * 10**8))
    check_sensor(Memory(panorama="equirectangular", batch=3), RecordedPoses())
    assert np.array_equal(taken(Memory(panorama="equirectangular", batch=3)), np.stack(stream.images))


def test_each_nth_image_between_two_times() -> None:
    stream = held(40)
    sensor = Memory(panorama="equirectangular", every=3, from_s=0.5, to_s=2.0)
    assert sensor.plan(RecordedPoses()).keys == [f"memory#{row}" for row in (5, 8, 11, 14, 17, 20)]
    frames = next(sensor.frames(sensor.plan(RecordedPoses()).at([1, 4])))
    assert frames.stamps_ns.tolist() == stream.stamps_ns[[8, 17]].tolist()
    assert np.array_equal(frames.images, [stream.images[8], stream.images[17]])


def test_a_key_names_the_pixels_and_what_is_done_to_them() -> None:
    stream = held(3)
    stream.images[2] = stream.images[0].copy()

    def digests(**settings: Any) -> list[str]:
        sensor = Memory(panorama="equirectangular", **settings)
        return [key.rpartition("@")[2] for f in sensor.frames(sensor.plan(RecordedPoses())) for key in f.keys]

    first, second, third = digests()
    assert first == third != second
    assert digests(mirrored=True)[0] != first


def test_grey_and_rgb_are_what_is_wanted() -> None:
    stream = held(2)
    colored = np.random.default_rng(1).integers(0, 255, (*SIZE, 3), np.uint8)
    stream.images[1] = colored
    rgb = taken(Memory(panorama="equirectangular", color=True))
    assert np.array_equal(rgb[1], colored)
    assert np.array_equal(rgb[0], np.repeat(stream.images[0][..., None], 3, -1))
    luma = colored @ [0.299, 0.587, 0.114]
    assert np.abs(taken(Memory(panorama="equirectangular"))[1] - luma).max() <= 1


def test_what_it_does_not_hold_is_said() -> None:
    held(4)
    with pytest.raises(DataError, match=r"memory is a sequence of 4 images.*omnilab convert"):
        Memory().plan(GridPoses(every=2))
    with pytest.raises(DataError, match=r"has no image from 5 s to inf s, it is 0.300 s long"):
        Memory(from_s=5).plan(RecordedPoses())
    with pytest.raises(ConfigError, match=r"to_s=1 is not after from_s=2"):
        Memory(from_s=2, to_s=1)
    with pytest.raises(ConfigError, match="entry='cam1' is given without a camera"):
        Memory(entry="cam1")


# -------------------------------------------------------------------------------------------------------------- images
def test_broken_images_are_left_out_with_their_reason_or_end_the_run() -> None:
    stream = held(6)
    stream.images[2] = "memory#2 is truncated"
    stream.images[4] = np.zeros((10, 10), np.uint8)
    sensor = Memory(panorama="equirectangular", on_bad_image=OnBadImage.skip)
    (frames,) = sensor.frames(sensor.plan(RecordedPoses()))
    assert frames.plan_index.tolist() == [0, 1, 3, 5]
    assert frames.omitted == ["memory#2 is truncated", "memory#4 is 10 x 10 pixels, the recording 96 x 24"]
    with pytest.raises(DataError, match=r"memory#2 is truncated; leave such images out with sensor.on_bad_image=skip"):
        taken(Memory(panorama="equirectangular"))


def test_a_stream_without_one_good_image() -> None:
    stream = held(3)
    stream.images[:] = [f"memory#{i} is damaged" for i in range(3)]
    with pytest.raises(DataError, match="of memory none of the images looked at can be read: memory#0 is damaged"):
        taken(Memory(on_bad_image=OnBadImage.skip))


# -------------------------------------------------------------------------------------------------------------- camera
def test_the_camera_is_the_recordings_own_unless_the_settings_name_one(tmp_path: Path) -> None:
    own = PinholeCamera(width=SIZE[1], height=SIZE[0], cx=47.5, cy=11.5, focal_px=50, looks="ahead")
    held(2, camera=own)
    assert Memory().optics.camera == own
    assert Memory(mirrored=True).optics.camera == own.flipped()
    assert isinstance(Memory(panorama="equirectangular").optics.camera, EquirectangularCamera)
    other = PinholeCamera(width=SIZE[1], height=SIZE[0], cx=40, cy=11, focal_px=60, looks="ahead")
    save_camera(other, tmp_path / "camera.json")
    assert Memory(camera=str(tmp_path / "camera.json")).optics.camera == other


def test_a_camera_of_another_size_is_refused() -> None:
    held(2, camera=PinholeCamera(width=640, height=480, cx=320, cy=240, focal_px=300, looks="ahead"))
    with pytest.raises(DataError, match="camera of images of 640 x 480 pixels, and images of 96 x 24"):
        taken(Memory())


# --------------------------------------------------------------------------------------------------------------- poses
def test_poses_are_interpolated_at_the_images_times(tmp_path: Path) -> None:
    stream = held(50, 0.07)
    rng = np.random.default_rng(5)
    R = Rotation.from_rotvec(np.cumsum(rng.normal(0, 0.3, (45, 3)), axis=0))
    position = np.cumsum(rng.normal(0, 0.1, (45, 3)), axis=0)
    times = BEGIN_NS - 50_000_000 + np.arange(45) * 80_000_000
    file = write_poses(tmp_path / "poses.tum", poses(position, R.as_matrix()), times)
    plan = Memory(panorama="equirectangular", positions=file).plan(RecordedPoses())
    assert len(plan) + len(plan.omitted) == 50
    rows = [int(key.partition("#")[2]) for key in plan.keys]
    at = (stream.stamps_ns[rows] - times[0]) / 1e9
    known = (times - times[0]) / 1e9
    assert plan.T_world_camera[:, :3, :3] == pytest.approx(Slerp(known, R)(at).as_matrix(), abs=1e-9)
    for axis in range(3):
        assert plan.T_world_camera[:, axis, 3] == pytest.approx(np.interp(at, known, position[:, axis]), abs=1e-9)


def test_images_without_a_pose_are_left_out_and_counted(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    held(20)
    times = BEGIN_NS + np.r_[3:8, 13:16] * 10**8
    file = write_poses(tmp_path / "poses.tum", planar_poses(np.zeros((8, 3))), times)
    plan = Memory(panorama="equirectangular", positions=file).plan(RecordedPoses())
    assert plan.keys == [f"memory#{row}" for row in (*range(3, 8), *range(13, 16))]
    assert len(plan.omitted) == 12
    assert plan.omitted[0] == f"memory#0 has no pose within 0.1 s on both sides in {file}"
    assert "12 of 20 images have no pose and are left out: that at 0.000 s has no pose within" in caplog.text
    wide = Memory(panorama="equirectangular", positions=file, tolerance_s=0.6).plan(RecordedPoses())
    assert [key.partition("#")[2] for key in wide.keys] == [str(row) for row in range(3, 16)]


def test_poses_too_far_apart_say_which_tolerance_would_do(tmp_path: Path) -> None:
    held(20)
    file = write_poses(
        tmp_path / "slow.tum", planar_poses(np.zeros((3, 3))), BEGIN_NS + np.arange(3) * 10**9 - 50_000_000
    )
    with pytest.raises(DataError, match=r"poses are 1 s apart: give sensor.tolerance_s=1"):
        Memory(positions=file).plan(RecordedPoses())
    assert len(Memory(positions=file, tolerance_s=1).plan(RecordedPoses())) == 20


def test_clocks_apart_by_years_are_said_with_both_spans_and_the_advice_works(tmp_path: Path) -> None:
    stream = held(20)
    file = write_poses(tmp_path / "poses.tum", planar_poses(np.zeros((20, 3))), np.arange(20) * 10**8)
    with pytest.raises(DataError, match=r"2023-11-14.*covers 0.000 s to 1.900 s; these are two clocks") as refused:
        Memory(positions=file).plan(RecordedPoses())
    advice = str(refused.value).partition("sensor.clock_offset_s=")[2].partition(" ")[0]
    assert float(advice) == pytest.approx(BEGIN_NS / 1e9, abs=1e-3)
    assert len(Memory(positions=file, clock_offset_s=float(advice)).plan(RecordedPoses())) >= 19
    assert len(stream.stamps_ns) == 20


def test_poses_without_times_or_out_of_order(tmp_path: Path) -> None:
    held(5)
    (tmp_path / "poses.csv").write_text("x_m,y_m\n0,0\n1,0\n")
    with pytest.raises(DataError, match="says where the camera was, and not when"):
        Memory(positions=str(tmp_path / "poses.csv")).plan(RecordedPoses())
    file = write_poses(tmp_path / "poses.tum", planar_poses(np.zeros((2, 3))), np.array([2, 1]) * 10**9)
    with pytest.raises(DataError, match=r"pose 2 of .* is not later than the one before it"):
        Memory(positions=file).plan(RecordedPoses())
    with pytest.raises(ConfigError, match=r"but no poses; give sensor.positions=FILE"):
        Memory(estimate_offset=True).plan(RecordedPoses())


def test_turned_pictures_turn_the_poses() -> None:
    held(3, poses=Trajectory(planar_poses(np.zeros((3, 3)), 1.0), BEGIN_NS + np.arange(3) * 10**8))
    plan = Memory(turned_deg=30).plan(RecordedPoses())
    assert heading_of(plan.T_world_camera) == pytest.approx(1 - np.pi / 6)


# -------------------------------------------------------------------------------------------------------------- clocks
@pytest.mark.parametrize("apart_s", [0.0, -2.37, 5e8])
def test_an_offset_is_estimated_by_turns_and_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, apart_s: float
) -> None:
    stream, heading = turning(200, 0.1)
    times = stream.stamps_ns - round(apart_s * 1e9)
    fine = np.arange(times[0], times[-1], 20_000_000)
    T = planar_poses(np.zeros((len(fine), 3)), np.interp(fine - times[0], times - times[0], heading))
    file = write_poses(tmp_path / "poses.tum", T, fine)
    sensor = Memory(panorama="equirectangular", positions=file, estimate_offset=True)
    plan = sensor.plan(RecordedPoses())
    assert sensor.source is not None
    assert (sensor.source.stamps_ns[0] - fine[0]) / 1e9 == pytest.approx(apart_s, abs=0.02)
    assert "where turns of images and of poses agree best (correlation " in caplog.text
    rows = [int(key.partition("#")[2]) for key in plan.keys]
    assert heading_of(plan.T_world_camera) == pytest.approx(heading[rows], abs=0.1)


def test_an_offset_that_nothing_shows_is_refused(tmp_path: Path) -> None:
    stream, heading = turning(120, 0.1)
    straight = write_poses(tmp_path / "straight.tum", planar_poses(np.zeros((120, 3))), stream.stamps_ns)
    with pytest.raises(DataError, match=r"correlate to .* at best.*give sensor.clock_offset_s"):
        Memory(panorama="equirectangular", positions=straight, estimate_offset=True).plan(RecordedPoses())
    against = write_poses(tmp_path / "against.tum", planar_poses(np.zeros((120, 3)), -heading), stream.stamps_ns)
    with pytest.raises(DataError, match=r"they run against each other.*sensor.mirrored=true"):
        Memory(panorama="equirectangular", positions=against, estimate_offset=True).plan(RecordedPoses())
    stream.images[:] = [stream.images[0]] * len(stream.images)
    file = write_poses(tmp_path / "poses.tum", planar_poses(np.zeros((120, 3)), heading), stream.stamps_ns)
    with pytest.raises(DataError, match="120 images show turns of 0 degrees in all, too little to tell"):
        Memory(panorama="equirectangular", positions=file, estimate_offset=True).plan(RecordedPoses())
