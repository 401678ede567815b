"""`omnilab convert`: from a bag to the documented folder and to MCAP, and back, bit for bit; and wheels out of a log."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from omnilab.api import RecordedPoses
from omnilab.cameras import BrownConradyCamera
from omnilab.errors import ConfigError, DataError
from omnilab.runner.cli import main
from omnilab_recordings import Folder, Mcap, Recorded, RosBag
from omnilab_recordings.conversion import command

BEGIN_NS = 1_700_000_000_000_000_000
TENTH = 10**8


@pytest.fixture
def convert(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    """The command, the study that it starts in this process."""
    monkeypatch.chdir(tmp_path)

    def render(overrides: Sequence[str]) -> object:
        with pytest.raises(SystemExit) as end:
            main(["experiment=render", "study.layout=recorded", *overrides, "study.show=0", "~sink@sinks.rerun"])
        return end.value.code

    monkeypatch.setattr(command, "_render", render)
    return lambda *arguments: command.convert(list(map(str, arguments)))


def messages(maker, pictures, with_poses: bool) -> list:
    found = [("/cam/camera_info", BEGIN_NS, maker.info((20, 64), 50, D=np.array([-0.1, 0.02, 0, 0, 0])))]
    for i, picture in enumerate(pictures):
        t, half = BEGIN_NS + i * TENTH, 0.05 * i
        found.append(("/cam/image_raw", t, maker.image(picture, t)))
        turn = [0.1 * math.sin(half), 0, math.sin(half) * math.sqrt(0.99), math.cos(half)]
        if with_poses:
            found.append(("/tf", t, maker.tf(maker.transform("map", "cam", [0.1 * i, 0.3, 1], turn, t))))
        found.append(("/odom", t, maker.odometry([0.11 * i, 0, 0], [0, 0, math.sin(half), math.cos(half)], t)))
    return found


def recorded(sensor):
    plan = sensor.plan(RecordedPoses())
    (frames,) = sensor.frames(plan)
    return frames.images, frames.stamps_ns, plan.T_world_camera, frames.camera


@pytest.mark.parametrize("with_poses", [True, False])
def test_a_bag_comes_back_from_its_folder_and_from_mcap(ros1, pictures, convert, tmp_path, with_poses: bool) -> None:
    maker, write = ros1
    bag = write(messages(maker, pictures, with_poses))
    assert convert(bag, "out", "--mcap", "out.mcap") == 0
    images, stamps, T, camera = recorded(RosBag(str(bag)))
    assert np.array_equal(images, pictures)
    assert isinstance(camera, BrownConradyCamera)
    for sensor, tolerance in ((Folder("out"), 0), (Mcap("out.mcap"), 1e-14)):
        others = recorded(sensor)
        assert np.array_equal(others[0], images)
        assert np.array_equal(others[1], stamps)
        assert others[3] == camera
        if with_poses:
            assert others[2] == pytest.approx(T, abs=tolerance, rel=0)
        else:
            assert others[2] is None is T


def test_it_goes_on_and_replaces_nothing(ros1, pictures, convert, tmp_path, capsys) -> None:
    maker, write = ros1
    bag = write(messages(maker, pictures, with_poses=True))
    assert convert(bag, "out") == 0
    first, second = (tmp_path / "out/images" / f"{i:06d}.png" for i in (0, 1))
    there = first.read_bytes(), first.stat().st_mtime_ns
    second.unlink()
    assert convert(bag, "out") == 0
    assert (first.read_bytes(), first.stat().st_mtime_ns) == there
    assert np.array_equal(recorded(Folder("out"))[0], pictures)
    second.write_bytes(there[0])
    assert convert(bag, "out") == 2
    assert "000001.png is another image than the recording has there" in capsys.readouterr().err
    assert second.read_bytes() == there[0]
    assert convert(bag, "out", "every=2") == 2
    assert "holds another data set: its sensor.every is 1, not 2" in capsys.readouterr().err


def test_what_it_cannot_convert_is_said(convert, tmp_path) -> None:
    (tmp_path / "there.mcap").touch()
    with pytest.raises(ConfigError, match=r"there.mcap is there already; give a new file"):
        convert("drive.bag", "out", "--mcap", "there.mcap")
    with pytest.raises(DataError, match=r"drive.bag cannot be read \(No such file or directory\)"):
        convert("drive.bag", "out")
    (tmp_path / "drive.bag").write_bytes(b"#ROSBAG V2.0\n")
    with pytest.raises(ConfigError, match="'color' is no setting of a sensor; write NAME=VALUE"):
        convert("drive.bag", "out", "color")


def test_the_sensor_follows_from_the_source(tmp_path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"\x89MCAP0\r\n")
    assert command.sensor_of(tmp_path / "a.mcap") == "mcap"
    assert command.sensor_of(tmp_path) == "rosbag"
    (tmp_path / "a.mcap").unlink()
    assert command.sensor_of(tmp_path) == "folder"
    (tmp_path / "rgb.txt").write_text("1.5 a.png\n")
    assert command.sensor_of(tmp_path) == "sequence"
    (tmp_path / "zind_data.json").write_text("{}")
    with pytest.raises(
        DataError, match="is a tour of ZInD, of several rooms and floors; give omnilab dataset prepare zind"
    ):
        command.sensor_of(tmp_path)
    assert command.sensor_of(tmp_path / "rgb.txt") == "video"  # which says what it is instead


def test_recorded_odometry_is_a_topic_of_a_log(ros1, pictures) -> None:
    maker, write = ros1
    bag = str(write(messages(maker, pictures, with_poses=True)))
    sensor = RosBag(bag)
    (frames,) = sensor.frames(sensor.plan(RecordedPoses()))
    readings = Recorded(bag, topic="/odom").extract(frames)
    assert np.array([one.pose for one in readings]) == pytest.approx(
        np.array([[0.11 * i, 0, 0.1 * i] for i in range(8)])
    )
    with pytest.raises(ConfigError, match=r"/wheels is no topic of poses in .*; it has /odom"):
        Recorded(bag, topic="/wheels").extract(frames)
