"""Paths and heights that no method can be judged by: a robot that stands still, no loops, an altimeter that says 0."""

import numpy as np
import pytest

from omnilab.api import Heights
from omnilab.geometry import planar_poses
from omnilab.trajectory.evaluation import Alignment, evaluate
from omnilab_studies.altitude.results import HeightEstimates, spread_of
from omnilab_studies.trajectory.loop_evaluation import evaluate_loops
from omnilab_studies.trajectory.results import _loop_metrics

STILL = planar_poses(np.zeros((6, 3)))
LINE = planar_poses(np.column_stack([np.arange(6.0), np.zeros((6, 2))]))
CLOSURES = np.array([[0, 3], [1, 5]])
NONE = np.zeros((0, 2), int)


def by_name(metrics):
    return {metric.name: metric for metric in metrics}


def test_closures_of_a_robot_that_stood_still_are_neither_right_nor_wrong():
    found = by_name(_loop_metrics(evaluate_loops(CLOSURES, STILL, None), CLOSURES))
    assert np.isnan(found["closure_precision"].value)
    assert found["closure_precision"].note == "the true path has no length: the robot stood still"
    assert found["closures"].value == 2


def test_without_closures_and_revisits_there_are_no_rates():
    found = by_name(_loop_metrics(evaluate_loops(NONE, LINE, None), NONE))
    assert np.isnan(found["closure_precision"].value)
    assert found["closure_precision"].note == "no loop was closed"
    assert np.isnan(found["closure_recall"].value)
    assert found["closure_recall"].note == "no image shows a place that was shown before"


def test_wrong_closures_on_a_line_are_wrong():
    assert evaluate_loops(CLOSURES, LINE, None).precision == 0


@pytest.mark.parametrize("alignment", [Alignment.sim2, Alignment.sim3])
def test_an_estimate_is_not_shrunk_onto_a_robot_that_stood_still(alignment):
    found = evaluate(LINE, STILL, alignment)
    assert found.scale == 1
    assert found.ate_m == pytest.approx(np.std(np.arange(6)))
    assert np.isnan(found.drift)
    assert np.isnan(found.end_drift)


@pytest.mark.parametrize("alignment", [Alignment.sim2, Alignment.sim3])
def test_an_estimate_that_stands_still_is_as_wrong_as_the_path_is_long(alignment):
    found = evaluate(STILL, LINE, alignment)
    assert found.scale == 1
    assert found.ate_m == pytest.approx(np.std(np.arange(6)))


def heights(values):
    values = np.asarray(values, float)
    height_m = 0.1 * np.arange(len(values))
    found = Heights(values, "px", np.ones(len(values)), np.zeros(len(values)))
    return HeightEstimates(0, height_m, height_m, found, np.zeros(len(values)))


def test_an_altimeter_that_always_says_0_has_no_spread():
    assert np.isnan(spread_of([heights([0, 0, 0]), heights([0, 0, 0])]))
    assert np.isnan(spread_of([heights([np.nan] * 3)]))
    assert spread_of([heights([0, 1, 2]), heights([0, 1, 2])]) == 0


def test_an_image_in_which_odometry_makes_out_nothing_is_a_failed_step():
    from omnilab.api import Motion, Parts, Unusable
    from omnilab.runner.recorder import Recorder
    from omnilab_studies.view_slam.mapping_run import FAILED, ViewMappingRun

    class Blinking:
        """Sees, sees nothing, sees, sees."""

        def __init__(self):
            self.seen = iter(["a", Unusable("the image is black"), "b", "c"])

        def extract(self, _):
            return [next(self.seen)]

        def estimate(self, before, now, _):
            assert (before, now) == ("b", "c")
            return Motion(np.ones(3), np.eye(3), "m")

    record = Recorder()
    run = ViewMappingRun(Parts(odometry=Blinking()), {}, None, None, None, 0, record, set(), None)
    covariances = [run._motion(None)[1] for _ in range(4)]
    assert [np.array_equal(covariance, FAILED) for covariance in covariances] == [False, True, True, False]
    assert run.failed_steps == 2
    assert all("the image is black" in warning for warning in record.warnings)
