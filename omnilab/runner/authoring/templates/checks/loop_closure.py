import numpy as np
from omnilab import Frames
from omnilab.cameras import CylindricalCamera
from omnilab.runner.authoring.templates.components.loop_closure import MyLoopClosure
from omnilab.testing import check_loop_closure


def test_it_keeps_the_contract() -> None:
    check_loop_closure(MyLoopClosure())


def test_the_first_image_once_more_but_turned_closes_a_loop() -> None:
    images = np.random.default_rng(7).integers(0, 255, (5, 16, 128), np.uint8)
    images[4] = np.roll(images[0], -32, axis=1)  # a quarter to the left
    stamps = np.arange(5)
    camera = CylindricalCamera(128, 16)
    frames = Frames(images, list("abcde"), stamps, camera, stamps)
    database = MyLoopClosure(exclude=1).begin()
    rng = np.random.default_rng(0)
    found = [database.query(frames.at(i), None, 0.1, rng) for i in range(5)]
    assert [closures.nodes.tolist() for closures in found] == [[], [], [], [], [0]]
    assert np.allclose(found[4].motions, [[0, 0, np.pi / 2]])
