import numpy as np
from omnilab import GridPoses, PathPoses
from omnilab.geometry import planar_poses
from omnilab.runner.authoring.templates.components.sensor import MySensor
from omnilab.testing import check_sensor


def test_it_keeps_the_contract() -> None:
    check_sensor(MySensor())


def test_a_grid_has_a_place_at_each_step() -> None:
    plan = MySensor().plan(GridPoses(step_m=0.5, extent_m=(2.0, 1.0)))
    assert plan.T_world_camera is not None
    x, y, z = plan.T_world_camera[:, :3, 3].T
    assert sorted(set(x)) == [-1, -0.5, 0, 0.5, 1]
    assert sorted(set(y)) == [-0.5, 0, 0.5]
    assert set(z) == {1}


def test_a_turn_to_the_left_shifts_the_columns() -> None:
    sensor = MySensor(rows=16)
    poses = planar_poses([[0.5, 0.2, 1.0]] * 2, [0, np.pi / 4])
    (frames,) = sensor.frames(sensor.plan(PathPoses(poses)))
    straight, turned = frames.images.astype(int)  # azimuth grows along the columns
    assert np.abs(np.roll(straight, -8, axis=1) - turned).max() <= 1


def test_poses_outside_the_room_are_left_out_with_their_reason() -> None:
    plan = MySensor().plan(PathPoses(planar_poses([[0.0, 0, 1], [9.0, 0, 1]])))
    assert len(plan) == 1
    assert len(plan.omitted) == 1
