"""Data sets rendered by the installed command: any number of processes, interruptions, and read back by `folder`."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from omnilab.api import GridPoses, PathPoses, RecordedPoses
from omnilab.cameras import load_camera
from omnilab.geometry import heading_of, poses, rotation_xyz

SCRIPT = Path(sys.executable).with_name("omnilab")
WORLD = Path(__file__).parents[1] / "box_world.yaml"
SMALL = ["experiment=render", f"sensor.world={WORLD}", "sensor.size=64", "sensor.samples=1", "study.folder=set"]
GRID = [*SMALL, "study.step_m=0.25"]


def files(folder):
    return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def test_a_rendered_grid_reads_back_bit_for_bit(omnilab_here, tmp_path):
    from omnilab_mirror import Mirror
    from omnilab_recordings import Folder

    result = omnilab_here(*GRID)
    assert result.rc == 0, result.stderr
    mirror, folder = Mirror(world=str(WORLD), size=64, samples=1), Folder(str(tmp_path / "set"))
    wanted, found = mirror.plan(GridPoses(0.25)), folder.plan(RecordedPoses())
    assert len(found) == len(wanted) > 64
    assert np.array_equal(found.T_world_camera, wanted.T_world_camera)
    images = [
        np.concatenate([f.images for f in sensor.frames(plan)]) for sensor, plan in ((mirror, wanted), (folder, found))
    ]
    assert np.array_equal(*images)
    stamps = [
        np.concatenate([f.stamps_ns for f in sensor.frames(plan)])
        for sensor, plan in ((mirror, wanted), (folder, found))
    ]
    assert np.array_equal(*stamps)
    assert len(folder.plan(GridPoses(every=1))) == len(found)  # its cells form a grid
    assert load_camera(tmp_path / "set/camera.json") == mirror.camera


def test_a_path_with_6_degrees_of_freedom_is_imaged_as_it_is_told(omnilab_here, tmp_path):
    from omnilab_mirror import Mirror
    from omnilab_recordings import Folder

    (tmp_path / "path.csv").write_text("x_m,y_m,z_m,rx_deg,ry_deg,rz_deg\n0,0,1,10,-20,30\n0.5,0.5,1.2,0,0,90\n")
    result = omnilab_here(*SMALL, "study.layout=path", "study.path=path.csv")
    assert result.rc == 0, result.stderr
    folder = Folder(str(tmp_path / "set"))
    plan = folder.plan(RecordedPoses())
    assert np.isclose(heading_of(plan.T_world_camera)[1], np.pi / 2)
    T = poses([[0, 0, 1], [0.5, 0.5, 1.2]], rotation_xyz(*np.deg2rad([[10, 0], [-20, 0], [30, 90]])))
    mirror = Mirror(world=str(WORLD), size=64, samples=1)
    (direct,), (read,) = mirror.frames(mirror.plan(PathPoses(T))), folder.frames(plan)
    assert np.array_equal(direct.images, read.images)
    assert np.array_equal(direct.T_world_camera, read.T_world_camera)
    assert read.camera == direct.camera


@pytest.mark.slow
def test_depth_and_colour_come_back_bit_for_bit_from_anywhere(omnilab_here, tmp_path):
    from omnilab_mirror import Spherical
    from omnilab_recordings import Folder

    settings = ["sensor=spherical", f"sensor.world={WORLD}", "sensor.size=48", "sensor.samples=1", "sensor.color=true"]
    result = omnilab_here(
        "experiment=render", *settings, "sensor.depth=true", "study.folder=set", "study.layout=random", "study.count=9"
    )
    assert result.rc == 0, result.stderr
    folder = Folder(str(tmp_path / "set"), color=True, depth=True)
    (read,) = folder.frames(folder.plan(RecordedPoses()))
    sensor = Spherical(world=str(WORLD), size=48, samples=1, color=True, depth=True)
    (direct,) = sensor.frames(sensor.plan(PathPoses(read.T_world_camera)))
    assert np.array_equal(read.images, direct.images)
    assert np.array_equal(read.depth_m, direct.depth_m)
    assert read.camera == direct.camera == sensor.camera


@pytest.mark.slow
def test_disturbances_spoil_the_images_the_same_whatever_the_processes(omnilab, omnilab_here, tmp_path):
    small = [*SMALL, "study.step_m=0.35", "sensor.size=32"]
    assert omnilab_here(*small, "disturbance=gaussian_noise", "study.folder=one").rc == 0
    result = omnilab(*small, "disturbance=gaussian_noise", "study.folder=two", "study.processes=2")
    assert result.rc == 0, result.stderr
    one = files(tmp_path / "one")
    assert one == files(tmp_path / "two")
    assert len(one) > 64
    assert omnilab_here(*small, "study.folder=clear").rc == 0
    assert files(tmp_path / "clear")["images/000000.png"] != one["images/000000.png"]
    refused = omnilab_here(*small, "study.folder=one")
    assert refused.rc == 2
    assert "its disturbances" in refused.stderr


def alive(pids):
    return [pid for pid in pids if Path(f"/proc/{pid}").exists() and "Z" not in Path(f"/proc/{pid}/stat").read_text()]


@pytest.mark.slow
@pytest.mark.parametrize(("number", "processes"), [(signal.SIGINT, 1), (signal.SIGINT, 2), (signal.SIGKILL, 2)])
def test_a_run_that_is_ended_leaves_whole_images_and_is_gone_on_with(omnilab, tmp_path, number, processes):
    many = [*SMALL, "study.step_m=0.06", f"study.processes={processes}", "study.show=0"]
    run = subprocess.Popen([SCRIPT, *many], cwd=tmp_path, stderr=subprocess.PIPE, text=True, start_new_session=True)
    children = Path(f"/proc/{run.pid}/task/{run.pid}/children")
    end = time.monotonic() + 90
    while len(list(tmp_path.glob("set/images/*.png"))) < 100:
        assert run.poll() is None, run.stderr.read()
        assert time.monotonic() < end
        time.sleep(0.02)
    workers = children.read_text().split() if children.exists() else []
    run.send_signal(number)
    run.communicate(timeout=60)
    assert run.returncode == (130 if number == signal.SIGINT else -signal.SIGKILL)
    end = time.monotonic() + 20
    while alive(workers):
        assert time.monotonic() < end
        time.sleep(0.1)
    there = list(tmp_path.glob("set/images/*.png"))
    assert all(path.read_bytes()[-8:-4] == b"IEND" for path in there)  # each is whole
    assert not (tmp_path / "set/positions.csv").exists()
    before = {path: path.stat().st_mtime_ns for path in there}
    result = omnilab(*many)
    assert result.rc == 0, result.stderr
    assert before.items() <= {path: path.stat().st_mtime_ns for path in tmp_path.glob("set/images/*.png")}.items()
    assert not list(tmp_path.glob("set/**/*.part"))
