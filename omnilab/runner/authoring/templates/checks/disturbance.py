import numpy as np
from omnilab.cameras import HyperbolicMirror
from omnilab.runner.authoring.templates.components.disturbance import MyDisturbance
from omnilab.testing import check_disturbance


def test_it_keeps_the_contract() -> None:
    check_disturbance(MyDisturbance(), harmless=MyDisturbance(share=0))


def test_as_many_pixels_as_it_says_are_spoiled() -> None:
    grey = np.full((1, 400, 400), 128, np.uint8)
    rng = np.random.default_rng(1)
    found = MyDisturbance(share=0.1).apply(grey, HyperbolicMirror(400), [rng])
    assert np.isclose((found == 0).mean(), 0.05, atol=0.005)
    assert np.isclose((found == 255).mean(), 0.05, atol=0.005)
