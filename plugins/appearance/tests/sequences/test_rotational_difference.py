"""The rotational image difference function, against every rotation spelled out."""

import numpy as np
import pytest

from omnilab.api import Signatures
from omnilab.errors import DataError
from omnilab.testing import check_distance
from omnilab_appearance import RotationalDifference

IMAGES = np.random.default_rng(4).integers(0, 255, (5, 6, 24)).astype(np.float32)


def test_keeps_the_contract():
    check_distance(RotationalDifference())


def test_it_is_the_least_of_all_rotations():
    own = RotationalDifference()
    found = own.match(Signatures(IMAGES[:2]), own.prepare(Signatures(IMAGES)))
    for q in range(2):
        for p in range(5):
            every = [np.sqrt(np.mean((np.roll(IMAGES[p], -k, axis=-1) - IMAGES[q]) ** 2)) for k in range(24)]
            assert found.distance[q, p] == pytest.approx(min(every), abs=1e-3)
            assert abs(np.rad2deg(found.rotation_rad[q, p]) - (15 * np.argmin(every) + 180) % 360 + 180) <= 7.5


@pytest.mark.parametrize("columns", [0, 5, 23])
def test_a_turned_camera_is_the_same_place(columns):
    """A camera that turns counter-clockwise by k columns sees what was at column k at column 0."""
    own = RotationalDifference()
    found = own.match(Signatures(np.roll(IMAGES[:1], -columns, axis=-1)), own.prepare(Signatures(IMAGES[:1])))
    assert found.distance[0, 0] == pytest.approx(0, abs=1e-3)
    turned = np.rad2deg(found.rotation_rad[0, 0])
    assert abs((turned - 15 * columns + 180) % 360 - 180) < 4  # refined between the columns


def test_other_settings_are_a_sentence():
    own = RotationalDifference()
    with pytest.raises(DataError, match="describe both with the same settings"):
        own.match(Signatures(IMAGES[:, :3]), own.prepare(Signatures(IMAGES)))
