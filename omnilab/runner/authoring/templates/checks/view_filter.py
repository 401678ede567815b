import numpy as np
from omnilab.runner.authoring.templates.components.view_filter import MyViewFilter
from omnilab.testing import check_view_filter


def test_it_keeps_the_contract() -> None:
    check_view_filter(MyViewFilter())


def test_without_observations_variances_add_up() -> None:
    variances = np.diag([0.01, 0.04, 0.09])
    found = MyViewFilter().begin(np.zeros(3), variances)
    for _ in range(3):
        found.predict(np.zeros(3), variances)  # it stands, and does not know it
    assert np.allclose(found.pose()[1], 4 * variances)


def test_the_orientation_of_a_known_view_is_averaged_with_ones_own() -> None:
    unsure = np.diag([1e-12, 1e-12, 0.5])
    found = MyViewFilter().begin(np.zeros(3), unsure)
    view = found.know_view(np.array([1.0, 0, 0]), 1e-12 * np.eye(3))
    noise = np.array([[[0.5, 0], [0, 1e6]]])  # a bearing that is as unsure
    believed, _ = found.observe(np.array([view]), np.array([[-0.2, 0]]), noise)
    assert believed.tolist() == [True]
    pose, covariance = found.pose()
    assert np.isclose(pose[2], 0.1, atol=1e-3)  # between 0 and 0.2
    assert np.isclose(covariance[2, 2], 0.25, atol=1e-3)
