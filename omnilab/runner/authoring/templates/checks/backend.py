import numpy as np
from omnilab import PoseGraph
from omnilab.runner.authoring.templates.components.backend import MyBackend
from omnilab.testing import check_backend


def test_it_keeps_the_contract() -> None:
    check_backend(MyBackend())


def test_two_measurements_of_one_motion_are_averaged_by_their_weights() -> None:
    graph = PoseGraph(
        ids=np.arange(2),
        poses=np.array([[0.0, 0, 0], [5, 5, 1]]),
        edges=np.array([[0, 1], [0, 1]]),
        motions=np.array([[1.0, 0, 0], [2, 0, 0]]),
        information=np.array([np.eye(3), 3 * np.eye(3)]),
    )
    found = MyBackend().optimize(graph, covariances=True)
    assert np.allclose(found.poses[1], [(1 + 3 * 2) / 4, 0, 0], atol=1e-6)
    assert np.isclose(found.chi2, 0.75**2 + 3 * 0.25**2)
    assert found.covariances is not None
    assert np.allclose(found.covariances[1], np.eye(3) / 4, atol=1e-6)
