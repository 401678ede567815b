import numpy as np
from omnilab import Floats, Match, Places, Signatures
from omnilab.geometry import planar_poses
from omnilab.runner.authoring.templates.components.localizer import MyLocalizer
from omnilab.testing import check_localizer


def test_it_keeps_the_contract() -> None:
    check_localizer(MyLocalizer())


class Apart:
    """The distance of signatures that are positions on a line."""

    def prepare(self, places: Signatures) -> Floats:
        return places.place

    def match(self, queries: Signatures, index: Floats) -> Match:
        return Match(np.abs(queries.place - index.T).astype(np.float32))


def test_between_two_places_it_answers_what_lies_between_them() -> None:
    x = np.array([[0.0], [1.0], [5.0]], np.float32)
    poses = planar_poses(np.pad(x, ((0, 0), (0, 2))))
    localizer = MyLocalizer(neighbours=2)
    index = localizer.prepare(Places(Signatures(x), poses, list("abc")), Apart())
    found = localizer.locate(Signatures(np.array([[0.25]], np.float32)), index)
    assert np.allclose(found.position_m, [[0.25, 0, 0]])  # 3/4 of 0 m, 1/4 of 1 m
