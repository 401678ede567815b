"""Catchment areas and the visual compass, where both are known."""

from dataclasses import dataclass

import numpy as np
import pytest

from omnilab.api import Frames, Parts, Plan
from omnilab.cameras import EquirectangularCamera
from omnilab.errors import ConfigError
from omnilab.geometry import planar_poses
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_study
from omnilab_appearance import RotationalDifference, TinyImage
from omnilab_studies import Catchment
from omnilab_studies.common.pose_sources import Source
from omnilab_studies.localization.catchment.results import caught, compass_range, neighbourhoods


def test_descending_a_valley_is_caught_and_beyond_a_ridge_is_not():
    x = np.arange(10.0)
    line = np.column_stack([x, x * 0, x * 0])
    valley = np.array([9, 5, 3, 0, 2, 5, 7, 4, 3, 8.0])  # a ridge at 6
    near = neighbourhoods(line, 1.0, on_path=True)
    assert caught(valley, near, 3).tolist() == [True] * 6 + [False] * 4  # from the ridge the other side is steeper
    assert [each.tolist() for each in near[:2]] == [[0, 1], [1, 0, 2]]


def test_neighbours_of_a_grid_are_the_eight_around():
    x, y = np.meshgrid(np.arange(4.0), np.arange(3.0))
    grid = 0.5 * np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()])
    near = neighbourhoods(grid, 0.5, on_path=False)
    assert sorted(near[5].tolist()) == [0, 1, 2, 4, 5, 6, 8, 9, 10]
    cone = np.linalg.norm(grid - grid[5], axis=1)
    assert caught(cone, near, 5).all()
    assert caught(np.ones(12), near, 5).sum() == 1  # nothing leads anywhere


def test_the_compass_holds_up_to_the_first_that_is_off():
    assert compass_range(np.array([0, 10, -50, 170.0]), np.array([0, 3, 2, 1.0]), 45) == 1
    assert compass_range(np.array([0, 10, -40.0]), np.array([0, 3, 2.0]), 45) == 3


@dataclass
class Lamps:
    """Panoramas of a far pattern, turned by the camera's heading, that gets darker with the distance from the middle."""

    turn: float = 0.3

    def plan(self, layout):
        x = np.arange(11.0)
        return Plan([f"{i}" for i in range(11)], planar_poses(np.column_stack([x, 0 * x, 0 * x]), self.turn * x))

    def frames(self, plan):
        azimuth = (
            np.deg2rad(EquirectangularCamera(64, 32, 0, False, -90, 90).start_deg)
            + 2 * np.pi * (np.arange(64) + 0.5) / 64
        )
        images = []
        for key in plan.keys:
            i = int(key)
            look = azimuth + self.turn * i
            images.append(np.tile(100 + (60 - 5 * abs(i - 5)) * np.cos(look) + 20 * np.cos(3 * look), (32, 1)))
        camera = EquirectangularCamera(64, 32, 0, False, -90, 90)
        stack = np.round(images).astype(np.uint8)
        yield Frames(stack, plan.keys, np.arange(len(plan)), camera, np.arange(len(plan)), plan.T_world_camera)

    def scene(self):
        return None


def parts():
    return Parts(sensor=Lamps(), descriptor=TinyImage(rows=4, columns=64), distance=RotationalDifference())


def test_keeps_the_contract():
    check_study(Catchment(images=Source.recorded, references=3), parts())


def test_a_turning_camera_keeps_its_compass_and_its_valley():
    """From either side the pattern gets more alike up to the middle; the turns are those of the camera."""
    report = Catchment(images=Source.recorded, references=3).run(parts(), Recorder(), np.random.default_rng(0))
    found = {metric.name: metric.value for metric in report.metrics}
    assert found["descriptor_compass_error_median"] < 1.0
    assert found["descriptor_compass_range_median"] == 10
    middle = report.tables["catchment"]["reference"].index(5)
    assert report.tables["catchment"]["catchment"][middle] == pytest.approx(
        11
    )  # two halves and nine whole steps, each as wide
    assert set(report.figures) == {"differences", "areas", "compass", "rotations"}


def test_random_places_have_no_neighbours():
    with pytest.raises(ConfigError, match="has no neighbours to go to; give grid, path or recorded"):
        Catchment(images=Source.random)
