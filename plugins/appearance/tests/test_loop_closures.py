"""Loop closures on pictures drawn by hand: what is left out, what is refused, what is kept."""

from __future__ import annotations

import numpy as np
import pytest

from omnilab.api import CalibratedCamera, Frames, ImageFeatures, Unusable
from omnilab.cameras import THESIS_HALF
from omnilab.errors import ConfigError, DataError
from omnilab.testing import check_loop_closure
from omnilab_appearance import GeometricVerification, HogNearest, HogThreshold, NoLoopClosure
from omnilab_appearance.loop_closures.cosine_index import CosineIndex
from omnilab_appearance.odometries.planar_epipolar import RadonFeatures

RNG = np.random.default_rng(0)
PLACES = np.stack(  # pictures that have nothing in common: coarse blocks, stripes, fine blocks
    [
        np.kron(RNG.integers(0, 255, shape), np.ones((250 // shape[0], 250 // shape[1])))
        for shape in ((5, 5), (2, 50), (25, 25))
    ]
).astype(np.uint8)
POINTS = RNG.normal(size=(3, 150, 3))  # of three rooms, metres around the camera
VECTORS = RNG.integers(0, 255, (3, 150, 128)).astype(np.uint8)


def frames(order):
    count = len(order)
    return Frames(PLACES[list(order)], [str(i) for i in range(count)], np.arange(count), THESIS_HALF, np.arange(count))


def queried(closure, order, features=None, step=0.1):
    """The closures of each of the pictures, one after the other."""
    database, rng, images = closure.begin(), np.random.default_rng(1), frames(order)
    return [database.query(images.at(i), features[i] if features else None, step, rng) for i in range(len(order))]


def features_of(points, vectors, place=(0.0, 0.0), turn=0.0):
    """Features of points (F, 3), from a place and a heading."""
    seen = points - [*place, 0]
    c, s = np.cos(turn), np.sin(turn)
    seen = seen @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]).T
    directions = (seen / np.linalg.norm(seen, axis=1, keepdims=True)).astype(np.float32)
    level = np.column_stack([np.arctan2(directions[:, 1], directions[:, 0]) % (2 * np.pi), directions[:, 2]])
    return ImageFeatures(directions, level.astype(np.float32), vectors)


@pytest.mark.parametrize(
    "closure", [HogThreshold(exclude=1), HogNearest(exclude=1), GeometricVerification(exclude=1), NoLoopClosure()]
)
def test_conforms(closure):
    check_loop_closure(closure, frames([0, 1, 2, 0, 1]))


def test_the_same_picture_is_the_same_place_unless_it_was_just_before():
    closures = queried(HogThreshold(exclude=2), [0, 0, 0, 0, 1])
    assert [t.nodes.tolist() for t in closures] == [[], [], [], [0], []]
    assert closures[3].motions[0] == pytest.approx(0, abs=1e-6)
    assert closures[3].distances[0] == pytest.approx(0, abs=1e-6)


def test_none_recognises_nothing():
    assert [len(found.nodes) for found in queried(NoLoopClosure(), [0, 0, 0])] == [0, 0, 0]


def test_every_image_below_w_closes_a_loop_and_the_nearest_alone_under_its_own_name():
    order = [0, 0, 1, 0]  # equation 6.7 names no limit to how many
    assert sorted(queried(HogThreshold(exclude=1), order)[3].nodes.tolist()) == [0, 1]
    assert queried(HogNearest(exclude=1), order)[3].nodes.tolist() == [0]
    assert queried(HogThreshold(exclude=1, most=1), order)[3].nodes.tolist() == [0]


def test_positions_are_as_uncertain_as_usual_steps_are_long():
    closures = queried(HogThreshold(exclude=1, reach=2.0, turn_sigma_deg=3.0), [0, 1, 0], step=0.5)[2]
    assert np.sqrt(np.diag(closures.covariances[0])) == pytest.approx([1, 1, np.deg2rad(3)])


def test_the_turn_is_that_of_the_pictures():
    database, rng = HogThreshold(exclude=1).begin(), np.random.default_rng(1)
    for picture in (PLACES[0], PLACES[1], np.rot90(PLACES[0], -1)):  # what was ahead is on the right: turned left
        closures = database.query(
            Frames(picture[None], ["a"], np.zeros(1, int), THESIS_HALF, np.zeros(1, int)), None, 1, rng
        )
    assert closures.nodes.tolist() == [0]
    assert closures.motions[0] == pytest.approx([0, 0, np.pi / 2], abs=np.deg2rad(1))


@pytest.mark.parametrize("closure", [HogThreshold(exclude=1), GeometricVerification(exclude=1, least=20)])
def test_what_is_unusable_is_a_node_that_matches_nothing(closure):
    black, seen = Unusable("black"), features_of(POINTS[0], VECTORS[0])
    closures = queried(closure, [0, 1, 0, 2, 0], [black, features_of(POINTS[1], VECTORS[1]), black, black, seen])
    assert [t.nodes.tolist() for t in closures] == [[]] * 5


def test_geometry_confirms_the_same_place_and_tells_its_turn():
    features = [features_of(POINTS[k], VECTORS[k]) for k in (0, 1)] + [
        features_of(POINTS[0], VECTORS[0], (0.01, 0), 0.7)
    ]
    closures = queried(GeometricVerification(exclude=1), [0, 1, 0], features)[2]
    assert closures.nodes.tolist() == [0]
    assert closures.motions[0] == pytest.approx([0, 0, 0.7], abs=1e-2)


@pytest.mark.parametrize(
    "other",
    [
        pytest.param(features_of(POINTS[2], VECTORS[2]), id="nothing in common"),
        pytest.param(features_of(POINTS[2], VECTORS[0]), id="the same things in other places"),
        pytest.param(features_of(POINTS[0], VECTORS[0], (0.4, 0.2)), id="the same room from another place"),
    ],
)
def test_geometry_refuses_what_a_description_takes_for_the_same_place(other):
    features = [features_of(POINTS[0], VECTORS[0]), features_of(POINTS[1], VECTORS[1]), other]
    order = [0, 1, 0]  # the third picture is the first one
    assert queried(HogThreshold(exclude=1), order, features)[2].nodes.tolist() == [0]
    closures = queried(GeometricVerification(exclude=1), order, features)[2]
    assert closures.nodes.tolist() == []
    assert closures.candidates == 1  # it was compared by geometry


@pytest.mark.parametrize(("steps", "nodes"), [(2.0, []), (100.0, [1])])
def test_the_same_place_is_within_a_few_usual_steps(steps, nodes):
    features = [features_of(POINTS[0], VECTORS[0], (x, 0)) for x in (0, 0.005, 0.01, 0.05)]
    closures = queried(GeometricVerification(exclude=1, parallax_steps=steps), [0, 1, 2, 0], features)[3]
    assert closures.nodes.tolist() == nodes


@pytest.mark.parametrize(("pause", "closing"), [(0, [3, 4, 5, 6, 7]), (1, [3, 5, 7]), (3, [3, 7])])
def test_after_a_closure_some_images_look_for_none(pause, closing):
    """Rooms 0, 1, 2, and then the same again: each could close a loop."""
    order = [0, 1, 2, 0, 1, 2, 0, 1]
    features = [features_of(POINTS[place], VECTORS[place]) for place in order]
    closures = queried(GeometricVerification(exclude=1, alike=100, pause=pause), order, features)
    assert [image for image, found in enumerate(closures) if len(found.nodes)] == closing


def test_features_of_the_odometry_are_kept_without_what_it_adds_to_them():
    """A transform of every image would outweigh its features many times."""
    shared = [features_of(POINTS[k], VECTORS[k]) for k in (0, 1, 0)]
    transform = np.zeros((173, 180), np.float32)
    added = [RadonFeatures(f.directions, f.azimuth_level, f.vectors, transform) for f in shared]
    database, rng, images = GeometricVerification(exclude=1).begin(), np.random.default_rng(1), frames([0, 1, 0])
    found = [database.query(images.at(i), features, 0.1, rng) for i, features in enumerate(added)]
    assert [type(kept) for kept in database._features] == [ImageFeatures] * 3
    assert [closures.nodes.tolist() for closures in found] == [[], [], [0]]
    assert found[2].motions == pytest.approx(queried(GeometricVerification(exclude=1), [0, 1, 0], shared)[2].motions)


def test_a_negative_pause_is_refused():
    with pytest.raises(ConfigError, match="pause=-1"):
        GeometricVerification(pause=-1)


def test_an_index_grows_and_compares_with_all_but_the_last_ones():
    vectors = RNG.normal(size=(200, 5))
    index = CosineIndex()
    for vector in vectors:
        index.add(vector)
    unit = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    assert len(index) == 200
    assert index.distances(7) == pytest.approx(1 - unit[:192] @ unit[-1], abs=1e-6)
    assert len(index.distances(500)) == 0


@pytest.mark.parametrize(
    "wrong", [{"exclude": 0}, {"most": 0}, {"reach": 0}, {"turn_sigma_deg": -1}]
)  # fmt: skip
@pytest.mark.parametrize("kind", [HogThreshold, HogNearest, GeometricVerification])
def test_settings_that_close_any_loop_or_none_are_refused(kind, wrong):
    with pytest.raises(ConfigError, match="give"):
        kind(**wrong)


def test_an_uncalibrated_camera_is_refused():
    from omnilab.api import Circle
    from omnilab.cameras import ImageCircle

    camera = ImageCircle(250, 250, Circle(124.5, 124.5, 125))
    assert not isinstance(camera, CalibratedCamera)
    with pytest.raises(DataError, match="choose loop_closure=hog_threshold"):
        GeometricVerification().begin().query(
            Frames(PLACES[:1], ["a"], np.zeros(1, int), camera, np.zeros(1, int)), None, 1.0, np.random.default_rng(0)
        )
