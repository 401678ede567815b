"""Mishaps of the view filters: what cannot be used is refused or becomes a warning with its step, and costs no more."""

from __future__ import annotations

import numpy as np
import pytest

from omnilab.errors import ConfigError, DataError
from omnilab_slam import ViewEkf, ViewGraph
from omnilab_slam.view_model import is_covariance

Q = np.diag([0.02, 0.01, 0.01]) ** 2
R = np.array([[0.01, 0.003], [0.003, 0.02]])
FILTERS = pytest.mark.parametrize("view_filter", [ViewEkf(), ViewGraph()], ids=["ekf", "graph"])


@FILTERS
def test_a_view_that_is_nowhere_is_refused(view_filter):
    found = view_filter.begin(np.zeros(3), np.eye(3))
    with pytest.raises(DataError, match=r"a view at .* is nowhere"):
        found.know_view(np.array([0, np.nan, 0]), np.eye(3))
    with pytest.raises(DataError, match="positive definite"):
        found.know_view(np.zeros(3), -np.eye(3))
    assert len(found.views()) == 0


@FILTERS
def test_what_cannot_be_used_becomes_a_warning_with_its_step_and_costs_no_more(view_filter):
    found = view_filter.begin(np.zeros(3), 1e-6 * np.eye(3))
    found.add_view()
    assert not found.predict(np.array([1.0, 0, 0]), Q)
    assert "step 2: the motion is no number" in found.predict(np.array([np.nan, 0, 0]), Q)[0]
    assert "step 3: the motion's covariance is not positive definite" in found.predict(np.ones(3), -np.eye(3))[0]
    assert np.allclose(found.pose()[0], [1, 0, 0], atol=1e-9)
    good, bad = np.array([np.pi, 0.0]), np.array([np.nan, 0])
    believed, warnings = found.observe(np.array([0, 0, 0]), np.array([good, bad, good]), np.array([R, R, -R]))
    assert believed.tolist() == [True, False, False]
    assert "no numbers" in warnings[0]
    assert "step 3: view 0 has a covariance that is not positive definite" in warnings[1]
    assert found.finish().shape == (4, 3)


@FILTERS
def test_a_view_that_is_too_near_has_no_bearing(view_filter):
    found = view_filter.begin(np.zeros(3), 1e-6 * np.eye(3))
    found.add_view()
    believed, warnings = found.observe(np.array([0]), np.zeros((1, 2)), R[None])
    assert not believed.any()
    assert not warnings


@FILTERS
def test_standing_still_is_a_motion(view_filter):
    found = view_filter.begin(np.zeros(3), 1e-6 * np.eye(3))
    found.add_view()
    found.predict(np.array([2.0, 0, 0]), Q)
    before = found.pose()
    said = found.predict(np.zeros(3), np.zeros((3, 3)))  # so sure a motion is beyond GTSAM's Cholesky
    assert not [sentence for sentence in said if "from here on iSAM2 solves by QR" not in sentence]
    assert np.allclose(found.pose()[0], before[0], atol=1e-6)
    assert np.allclose(found.pose()[1], before[1], atol=1e-9)
    assert found.observe(np.array([0]), np.array([[np.pi, 0.0]]), R[None])[0].all()


def test_a_covariance_that_has_gone_bad_becomes_a_warning():
    found = ViewEkf().begin(np.zeros(3), 1e-6 * np.eye(3))
    found.add_view()
    found.predict(np.array([2.0, 0, 0]), Q)
    found._cov[0, 0] = -1.0
    found._cov[1, 1] = 1e-3
    before = found._state.copy()
    believed, warnings = found.observe(np.array([0]), np.array([[np.pi, 0.0]]), R[None])
    assert not believed.any()
    assert "step 1: the covariance is not positive definite" in warnings[0]
    assert np.array_equal(found._state, before)


def test_settings_and_starts_that_cannot_be_are_one_sentence():
    for settings in ({"gate_probability": 0.0}, {"gate_probability": 1.5}, {"nearest_m": 0.0}):
        for kind in (ViewEkf, ViewGraph):
            with pytest.raises(ConfigError, match=r"view_filter\..*give"):
                kind(**settings)
    for settings in ({"surprise": -1.0}, {"relinearize_every": 0}):
        with pytest.raises(ConfigError, match=r"view_filter\..*give"):
            ViewGraph(**settings)
    for kind in (ViewEkf(), ViewGraph()):
        with pytest.raises(DataError, match=r"a robot at .* is nowhere"):
            kind.begin(np.zeros(3), -np.eye(3))
    assert is_covariance(np.zeros((2, 2)))
    assert not is_covariance(np.full((2, 2), np.nan))
