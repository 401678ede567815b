import numpy as np
from omnilab import Signatures
from omnilab.runner.authoring.templates.components.distance import MyDistance
from omnilab.testing import check_distance


def test_it_keeps_the_contract() -> None:
    check_distance(MyDistance())


def test_distances_of_stripes_are_as_by_hand() -> None:
    stripes = np.array([[[1.0, -1, -1, 1, -1, -1]]], np.float32)
    distance = MyDistance()
    index = distance.prepare(Signatures(stripes))
    found = distance.match(Signatures(np.roll(stripes, -1, axis=2)), index)
    assert np.isclose(found.distance, 0, atol=1e-6)
    negative = distance.match(Signatures(-stripes), index)  # correlation 1/2 at best
    assert np.isclose(negative.distance, 0.5, atol=1e-6)
