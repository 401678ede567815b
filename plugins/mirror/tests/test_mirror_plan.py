"""Which poses the sensor answers a layout with, and how it names the images."""

from __future__ import annotations

import pickle
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import omnilab_mirror
from omnilab.api import GridPoses, PathPoses, Plan, RandomPoses, RecordedPoses, Sensor
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import heading_of, planar_poses
from omnilab_mirror import Mirror
from omnilab_mirror.scene.quads import Place, Solid


@pytest.mark.parametrize(("step", "count"), [(0.1, 4941), (0.2, 1271), (0.3, 567), (0.4, 336)])
def test_grid_has_the_nodes_that_the_studies_expect(step, count):
    plan = Mirror().plan(GridPoses(step_m=step))
    assert len(plan) + len(plan.omitted) == count
    assert 0.02 < len(plan.omitted) / count < 0.15


def test_grid_runs_x_fastest_from_the_south_west_corner_to_both_ends():
    plan = Mirror(on_floor=False).plan(GridPoses(step_m=0.5, extent_m=(2, 1), height_m=1.7))
    assert np.allclose(plan.T_world_camera[0, :3, 3], [-1, -0.5, 1.7])
    assert np.allclose(plan.T_world_camera[-1, :3, 3], [1, 0.5, 1.7])
    assert np.allclose(plan.T_world_camera[:5, 0, 3], [-1, -0.5, 0, 0.5, 1])
    assert np.all(heading_of(plan.T_world_camera) == 0)
    assert len(plan) == 15


def test_omitted_nodes_are_named_with_their_reason(write, small):
    plan = Mirror(world=write(small)).plan(GridPoses(step_m=0.4))
    assert list(plan.omitted) == [
        "x=0.60 y=0.60: inside 'crate'",
        "x=1.00 y=0.60: inside 'crate'",
        "x=0.60 y=1.00: inside 'crate'",
        "x=1.00 y=1.00: inside 'crate'",
    ]
    flying = Mirror(world=write(small), height_m=1.6, on_floor=False).plan(GridPoses(step_m=0.4))
    assert not flying.omitted
    carried = Mirror(world=write(small), height_m=1.6).plan(GridPoses(step_m=0.4))
    assert [why.replace("above", "inside") for why in carried.omitted] == list(plan.omitted)
    beyond = Mirror(world=write(small)).plan(GridPoses(step_m=2.5, extent_m=(5, 0)))
    assert list(beyond.omitted) == ["x=-2.50 y=0.00: outside the room", "x=2.50 y=0.00: outside the room"]


def test_random_poses_are_free_seeded_and_uniform():
    sensor = Mirror()
    plan, again, other = (sensor.plan(RandomPoses(2000, seed=seed)) for seed in (7, 7, 8))
    assert len(plan) == 2000
    assert np.array_equal(plan.T_world_camera, again.T_world_camera)
    assert list(plan.keys) == list(again.keys)
    assert not np.array_equal(plan.T_world_camera, other.T_world_camera)
    assert list(sensor.plan(PathPoses(plan.T_world_camera)).keys) == list(plan.keys)  # so none is in the way
    x, y, z = plan.T_world_camera[:, :3, 3].T
    assert np.abs(x).max() <= 4
    assert np.abs(y).max() <= 3
    assert np.all(z == 1)
    for values, width in ((x, 8), (y, 6), (heading_of(plan.T_world_camera), 2 * np.pi)):
        assert values.std() == pytest.approx(width / np.sqrt(12), rel=0.05)


def test_random_headings_keep_to_the_step():
    step = 2 * np.pi / 45
    headings = heading_of(Mirror().plan(RandomPoses(500, seed=1, heading_step_rad=step)).T_world_camera)
    multiples = np.rint(headings / step)
    assert np.allclose(headings, multiples * step)
    assert len(np.unique(multiples % 45)) == 45


@given(x=st.floats(-2, 2), y=st.floats(-2, 2), z=st.floats(-1, 3), turn=st.floats(-3, 3), clearance=st.floats(0, 0.3))
def test_solids_hold_what_lies_between_their_faces(x, y, z, turn, clearance):
    solid = Solid("box", Place(np.array([0.3, -0.2, 0.5]), turn), np.array([-1, -0.5, 0]), np.array([1, 0.5, 1.5]))
    dx, dy = x - 0.3, y + 0.2
    along, across = np.cos(turn) * dx + np.sin(turn) * dy, np.cos(turn) * dy - np.sin(turn) * dx
    margins = [1 - abs(along), 0.5 - abs(across), z - 0.5, 2 - z]
    if abs(min(margins) + clearance) > 1e-9:
        assert solid.holds(np.array([[x, y, z]]), clearance)[0] == (min(margins) > -clearance)


@pytest.mark.parametrize(
    ("layout", "message"),
    [
        (RecordedPoses(), "recorded nothing.*random poses"),
        (GridPoses(every=2), "step_m above 0, not None"),
        (GridPoses(step_m=-0.1), "step_m above 0"),
        (GridPoses(step_m=1.0, height_m=9.0), "none of the grid's 63 nodes is free at height 9 m"),
        (RandomPoses(10, seed=1, height_m=9.0), "less than 1 % .* is free"),
        (RandomPoses(0, seed=1), "count from 1 to 1000000"),
        (PathPoses(np.eye(4)), r"finite T_world_camera of shape \(N, 4, 4\)"),
        (PathPoses(np.full((2, 4, 4), np.nan)), "finite"),
        (PathPoses(planar_poses([0, -1, 1]) * [1, 1, -1, 1]), "rotations"),
        (
            PathPoses(planar_poses([[0, -1, 1], [0.4, 0.5, 1]])),
            r"pose 1 .*\(0.40, 0.50, 1.00\) m, is inside 'bookcase'",
        ),
        (PathPoses(planar_poses([6, 0, 1])), "outside the room"),
    ],
)
def test_layouts_that_cannot_be_answered(layout, message):
    with pytest.raises(DataError, match=message):
        Mirror().plan(layout)


@pytest.mark.parametrize("setting", [{"samples": 3}, {"samples": 0}, {"batch": 0}, {"crop": 1.5}, {"size": 2}])
def test_settings_that_cannot_be_used(setting):
    with pytest.raises(ConfigError, match=str(next(iter(setting.values())))):
        Mirror(**setting)


def test_plans_without_poses_are_refused():
    with pytest.raises(DataError, match="without poses"):
        next(Mirror().frames(Plan(["a"], None)))


def test_keys_name_the_content(write, small):
    layout = PathPoses(planar_poses([[0, 0, 1], [0, 0, 1.1], [0, 0, 1]], [0.0, 0, 0.1]))
    world = write(small)
    base = Mirror(world=world)
    keys = list(base.plan(layout).keys)
    assert len(set(keys)) == 3
    assert keys == list(Mirror(world=world, batch=2, height_m=2).plan(layout).keys)
    changed = [{"size": 200}, {"crop": 0.6}, {"a_mm": 41.0}, {"color": True}, {"samples": 1}]
    others = [Mirror(world=world, **change).plan(layout).keys[0] for change in changed]
    write(small.replace("[200, 40, 40]", "[200, 40, 41]"))
    others.append(base.plan(layout).keys[0])
    assert len({keys[0], *others}) == 7


def test_sensor_keeps_its_protocol_and_pickles_after_use():
    sensor = Mirror(size=32)
    plan = sensor.plan(RandomPoses(3, seed=1))
    images = next(sensor.frames(plan)).images
    assert isinstance(sensor, Sensor)
    copy = pickle.loads(pickle.dumps(sensor))
    assert copy == sensor
    assert np.array_equal(next(copy.frames(pickle.loads(pickle.dumps(plan)))).images, images)


def test_registers_as_mirror():
    found = {}
    omnilab_mirror.register_sensors(found.__setitem__)
    assert found["mirror"] is Mirror
    assert {cls.__name__ for cls in found.values()} == set(omnilab_mirror.__all__)


def test_import_is_light():
    code = "import sys, omnilab_mirror; print(sorted({'numba', 'cv2', 'yaml', 'scipy'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_worlds_as_data_load_without_the_renderer():
    code = (
        "import sys; from omnilab_mirror.scene.load import load_world; load_world('room');"
        " print([name for name in sys.modules if name.startswith('omnilab_mirror.render')])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_a_world_is_prepared_once_and_what_was_prepared_goes_with_it():
    import gc
    import weakref
    from dataclasses import replace

    from omnilab_mirror.render.prepared_world import baked_pictures, gray_atlas
    from omnilab_mirror.scene.load import load_world

    world = replace(load_world("room"), texels_per_m=8)
    assert baked_pictures(world) is baked_pictures(world)
    assert gray_atlas(world) is gray_atlas(world)
    texels = weakref.ref(gray_atlas(world).texels)
    assert texels() is not None
    del world
    gc.collect()
    assert texels() is None


# ------------------------------------------------------------------------------------------------ work that is too large
@pytest.mark.parametrize(("settings", "free", "told"), [
    ({"size": 256, "samples": 4}, 5e7, r"rays of an image of 256 x 256 pixels, 4 a pixel, take at least 52.4 MB of memory, and 50 MB are free; give a smaller image"),
    ({"size": 1024, "color": True, "depth": True, "batch": 16}, 1e8, r"16 images of 1024 x 1024 pixels at once take at least 0.117 GB of memory, and 0.1 GB are free; .* smaller sensor.batch"),
    ({"size": 8192, "samples": 1024, "batch": 1}, 1e15, r"20 images of 8192 x 8192 pixels with sensor.samples=1024 take at least .* hours of time"),
])  # fmt: skip
def test_images_beyond_memory_and_time_are_refused_before_the_first(write, small, monkeypatch, settings, free, told):
    sensor = Mirror(world=write(small), **settings)
    plan = Plan(["a"] * 20, np.tile(sensor.plan(GridPoses(step_m=1.0)).T_world_camera[:1], (20, 1, 1)))
    monkeypatch.setattr("omnilab.limits.free_memory", lambda: free)
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    monkeypatch.setattr("omnilab.limits.LONGEST_S", 6000)
    with pytest.raises(ConfigError, match=told):
        next(sensor.frames(plan))


def test_a_grid_that_is_too_fine_is_refused_with_its_nodes_memory_and_hours(monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 4)
    sensor = Mirror()
    with pytest.raises(ConfigError, match=r"the 4.8e\+09 nodes of a grid of 8 x 6 m with step_m=0.0001 \(all their images: 417 hours or more\) take at least 1200 GB"):  # fmt: skip
        sensor.plan(GridPoses(step_m=0.0001))
