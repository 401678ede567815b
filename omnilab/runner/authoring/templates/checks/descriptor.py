import numpy as np
from omnilab.runner.authoring.templates.components.descriptor import MyDescriptor
from omnilab.testing import check_descriptor


def test_it_keeps_the_contract() -> None:
    check_descriptor(MyDescriptor())


def test_a_step_of_ten_grey_levels_is_an_edge_of_ten() -> None:
    image = np.full((1, 4, 8), 20, np.uint8)
    image[:, :, 3:5] = 30
    found = MyDescriptor(rows=1, columns=8).describe(image).place
    assert found.tolist() == [[[0, 0, 10, 0, 10, 0, 0, 0]]]


def test_brightness_changes_nothing() -> None:
    image = np.random.default_rng(0).integers(0, 200, (1, 128, 512), np.uint8)
    dark, bright = (MyDescriptor().describe(i).place for i in (image, image + 50))
    assert np.array_equal(dark, bright)
