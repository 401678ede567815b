import numpy as np
from omnilab import Frames
from omnilab.cameras import CylindricalCamera
from omnilab.runner.authoring.templates.components.odometry import MyOdometry
from omnilab.testing import check_odometry


def test_it_keeps_the_contract() -> None:
    check_odometry(MyOdometry())


def test_a_turn_to_the_left_is_what_it_says() -> None:
    image = np.random.default_rng(5).integers(0, 255, (1, 16, 64), np.uint8)
    both = np.concatenate([image, np.roll(image, -8, axis=2)])  # by an eighth
    camera, stamps = CylindricalCamera(64, 16), np.arange(2)
    odometry = MyOdometry(step_m=1.0, columns=64)
    before, now = odometry.extract(Frames(both, ["a", "b"], stamps, camera, stamps))
    assert isinstance(before, np.ndarray)
    assert isinstance(now, np.ndarray)
    motion = odometry.estimate(before, now, np.random.default_rng(0))
    expected = [np.cos(np.pi / 8), np.sin(np.pi / 8), np.pi / 4]
    assert np.allclose(motion.vector, expected)
