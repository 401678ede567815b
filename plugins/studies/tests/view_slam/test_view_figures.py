"""Figures of views: walls of a world on the plan, how far ellipses are magnified, the range about the robot."""

from __future__ import annotations

import numpy as np
import pytest

from omnilab.api import Mesh
from omnilab_studies.view_slam import figures
from omnilab_studies.view_slam.drives import Drives
from omnilab_studies.view_slam.filter_runs import FilterEstimate
from omnilab_studies.view_slam.scenarios import scenario
from omnilab_studies.view_slam.wall_lines import wall_lines

TETRAHEDRON = Mesh(
    np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 2]]),
    np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]),
    np.zeros((4, 3), np.uint8),
)


def test_walls_are_where_the_plane_cuts_the_surface():
    half = wall_lines(TETRAHEDRON, 1.0)
    corners = {tuple(sorted(map(tuple, np.round(line, 3).tolist()))) for line in half}
    assert corners == {((0, 0), (1, 0)), ((0, 0), (0, 1)), ((0, 1), (1, 0))}
    assert len(wall_lines(TETRAHEDRON, 5.0)) == len(wall_lines(None, 1.0)) == 0


@pytest.mark.parametrize(("sigma_m", "factor"), [(1.0, 1), (0.005, 20), (1e-9, 1000)])
def test_ellipses_are_magnified_until_they_can_be_seen(sigma_m, factor):
    assert figures.magnification(np.tile(sigma_m**2 * np.eye(3), (4, 1, 1)), 10.0) == factor


def test_the_map_shows_walls_and_the_errors_of_odometry_and_the_range_is_a_circle_about_the_robot():
    ground = scenario("walls")
    drive = Drives().drive(ground, 5, np.random.default_rng(0))
    count = len(drive.truth)
    estimate = FilterEstimate(
        drive.truth, np.tile(1e-4 * np.eye(3), (count, 1, 1)), drive.truth[:2], np.ones((2, 3, 3))
    )
    above, *panels = figures.drive(drive, ground, estimate, "ekf", 6.0).axes
    assert len(above.collections[0].get_segments()) == len(ground.walls_m)
    drawn = [next(line.get_ydata() for line in axes.lines if line.get_label() == "odometry") for axes in panels]
    assert np.allclose(drawn[:2], (drive.odometry - drive.truth)[:, :2].T)
    (plan,) = figures.scenarios({"walls": (ground, drive)}, 6.0).axes
    circle = next(line.get_xydata() for line in plan.lines if "range" in line.get_label())
    assert np.linalg.norm(circle - drive.truth[len(ground.lap) // 2, :2], axis=1) == pytest.approx(6.0)
