import numpy as np
from omnilab.cameras import EquirectangularCamera
from omnilab.runner.authoring.templates.components.altimeter import MyAltimeter
from omnilab.testing import check_altimeter


def test_it_keeps_the_contract() -> None:
    check_altimeter(MyAltimeter())


def test_a_panorama_that_moves_down_was_taken_from_higher_up() -> None:
    image = np.random.default_rng(3).integers(0, 255, (1, 32, 128), np.uint8)
    camera = EquirectangularCamera(128, 32, lowest_deg=-40, highest_deg=40)
    altimeter = MyAltimeter(rows=32, most=5)
    for rows in (-3, 0, 4):
        moved = np.roll(image, (rows, -16), axis=(1, 2))  # turned to the left, too
        found = altimeter.relative(image, moved, camera)
        assert found.value.tolist() == [rows]
        assert np.isclose(found.rotation_rad, np.pi / 4)
