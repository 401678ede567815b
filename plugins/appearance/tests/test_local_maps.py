"""Springs and stress majorisation against exact distances, known optima, scikit-learn and a damped oscillator."""

import logging

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.manifold import MDS

from omnilab.api import Places, Signatures
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import planar_poses, procrustes
from omnilab.testing import check_embedder
from omnilab_appearance import Cosine, Euclidean, Smacof, Spring
from omnilab_appearance.localizers import map_kernels
from omnilab_appearance.localizers.local_maps import Constants, connected, most_alike
from omnilab_appearance.localizers.smacof import classical_scaling
from omnilab_appearance.localizers.spring import Integrator

MAKERS = [
    Smacof(),
    Smacof(constants=Constants.inverse_square),
    Spring(),
    Spring(constants=Constants.inverse_square, starts=8),
    Spring(integrator=Integrator.euler),
]
NAMES = ["smacof", "smacof_weighted", "spring", "spring_weighted", "spring_euler"]


def distances(points):
    """(..., n, n) of points (..., n, 2)."""
    return np.linalg.norm(points[..., :, None, :] - points[..., None, :, :], axis=-1)


def noisy(seed, n=10, sets=1, noise=0.2):
    """Distances of points in a square, each spoilt by its own factor."""
    rng = np.random.default_rng(seed)
    exact = distances(rng.uniform(0, 1, (sets, n, 2)))
    factor = np.triu(rng.normal(0, noise, exact.shape), 1)
    return exact * np.exp(factor + factor.swapaxes(1, 2))


@pytest.mark.slow
@pytest.mark.parametrize("maker", MAKERS, ids=NAMES)
def test_keeps_the_contract(maker):
    check_embedder(maker)


@given(st.integers(0, 2**32 - 1), st.integers(3, 30), st.floats(1e-6, 1e6))
@settings(max_examples=12)
def test_smacof_keeps_the_distances_of_a_plane(seed, n, scale):
    points = scale * np.random.default_rng(seed).uniform(-1, 1, (2, n, 2))
    made = Smacof().embed(distances(points), np.random.default_rng(0))
    assert np.abs(procrustes(made.position, points, scale=False).apply(made.position) - points).max() < 1e-6 * scale


@pytest.mark.parametrize("constants", Constants)
@pytest.mark.parametrize(
    ("integrator", "step_s"), [(Integrator.verlet, 0.03), pytest.param(Integrator.euler, 0.005, marks=pytest.mark.slow)]
)
def test_springs_keep_the_distances_of_a_plane_to_a_hundredth_of_their_mean(integrator, step_s, constants):
    points = np.random.default_rng(5).uniform(-1, 1, (6, 10, 2))
    exact = distances(points)
    maker = Spring(integrator=integrator, constants=constants, step_s=step_s, starts=16)
    made = maker.embed(exact, np.random.default_rng(0))
    fitted = procrustes(made.position, points, scale=False).apply(made.position)
    assert np.abs(fitted - points).max() < 0.01 * exact.mean()


def test_a_finer_tolerance_keeps_them_better():
    points = np.random.default_rng(5).uniform(-1, 1, (4, 10, 2))
    made = Spring(tolerance=1e-8, starts=8).embed(distances(points), np.random.default_rng(0))
    assert np.abs(distances(made.position) - distances(points)).max() < 1e-5


@pytest.mark.parametrize("maker", MAKERS, ids=NAMES)
def test_four_points_all_alike_settle_in_a_square(maker):
    """The least stress of a tetrahedron in the plane: sides a, diagonals √2 a, a = (2 + √2) / 4 (4 (a-1)² + 2 (√2 a-1)²)."""
    made = maker.embed(1 - np.eye(4)[None], np.random.default_rng(0))
    side = (2 + np.sqrt(2)) / 4
    lengths = np.sort(distances(made.position[0])[np.triu_indices(4, 1)])
    assert np.allclose(lengths, [side] * 4 + [np.sqrt(2) * side] * 2, atol=5e-3)
    least = np.sqrt((4 * (side - 1) ** 2 + 2 * (np.sqrt(2) * side - 1) ** 2) / 6)
    assert np.isclose(made.stress[0], least, rtol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("maker", MAKERS[:4], ids=NAMES[:4])
def test_the_order_of_the_images_does_not_matter(maker):
    points = np.random.default_rng(6).uniform(-1, 1, (5, 8, 2))
    order = np.random.default_rng(7).permutation(8)
    exact = distances(points)
    made = maker.embed(exact, np.random.default_rng(0))
    other = maker.embed(exact[:, order][:, :, order], np.random.default_rng(0))
    assert np.allclose(distances(other.position), distances(made.position)[:, order][:, :, order], atol=0.01)


@given(st.integers(0, 2**32 - 1), st.sampled_from(Constants))
@settings(max_examples=20)
def test_the_stress_of_smacof_never_rises(seed, constants):
    maker = Smacof(constants=constants)
    given_ = noisy(seed)
    steps = maker.embed(given_, np.random.default_rng(0), steps=40).steps
    weights = maker._weights(given_, given_ > 0)
    stress = (weights * (distances(steps) - given_) ** 2).sum(axis=(1, 2, 3))
    assert (np.diff(stress) <= 1e-12 * stress[0]).all()
    assert stress[-1] < stress[0]


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_springs_end_where_no_force_is_left(seed):
    """The gradient of the energy vanishes, and from start to end the energy fell."""
    given_ = noisy(seed)
    made = Spring(tolerance=1e-7, iterations=100_000).embed(given_, np.random.default_rng(0), steps=10)

    def energy(x):
        return 0.25 * ((distances(x) - given_[0]) ** 2).sum()

    x = made.position[0]
    slope = np.array([(energy(x + h) - energy(x - h)) / 2e-6 for h in 1e-6 * np.eye(20).reshape(20, 10, 2)])
    assert np.abs(slope).max() < 1e-4
    assert energy(made.steps[0, 0]) > energy(made.steps[5, 0]) > energy(x)


def test_smacof_reaches_the_stress_that_scikit_learn_reaches_from_the_same_start():
    given_ = noisy(1, n=12, sets=10)
    ours = Smacof().embed(given_, np.random.default_rng(0)).stress
    for stress, distance in zip(ours, given_, strict=True):
        theirs = MDS(n_init=1, init="classical_mds", metric="precomputed", random_state=0, eps=1e-7, max_iter=3000)
        found = distances(theirs.fit_transform(distance))
        assert stress < 1.001 * np.sqrt(((found - distance) ** 2).sum() / (distance**2).sum())


def test_classical_scaling_is_exact_in_the_plane_and_leaves_a_line():
    points = np.random.default_rng(2).uniform(-1, 1, (3, 9, 2))
    assert np.allclose(distances(classical_scaling(distances(points), np.random.default_rng(0))), distances(points))
    line = distances(np.linspace(0, 1, 6)[None, :, None] * [1.0, 0.0])
    assert 0 < np.abs(classical_scaling(line, np.random.default_rng(0))[0, :, 0]).max() < 2e-3


def test_missing_distances_are_found_from_the_others():
    points = np.random.default_rng(3).uniform(0, 1, (1, 30, 2))
    near = np.where(distances(points) < 0.6, distances(points), np.inf)
    made = Smacof(tolerance=1e-10).embed(near, np.random.default_rng(0))
    assert np.abs(distances(made.position) - distances(points)).max() < 1e-3
    by_threshold = Smacof(tolerance=1e-10, threshold=0.6).embed(distances(points), np.random.default_rng(0))
    assert np.array_equal(by_threshold.position, made.position)


def test_only_pairs_of_most_alike_images_count_where_they_are_linked():
    """On a line with gaps that grow each point takes its two neighbours, and the two at the ends take one beyond theirs."""
    points = np.zeros((1, 6, 2))
    points[0, :, 0] = [0, 1, 2.5, 4.5, 7, 10]
    pairs = np.argwhere(np.triu(most_alike(np.where(np.eye(6), np.inf, distances(points)), 2)[0]))
    assert pairs.tolist() == [[0, 1], [0, 2], [1, 2], [2, 3], [3, 4], [3, 5], [4, 5]]


def test_links_unbend_a_map_whose_far_distances_saturate():
    x, y = np.meshgrid(np.arange(12.0), np.arange(5.0))
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    exact = distances(points)
    bent = np.minimum(exact, 3.0)[None]

    def residual(maker):
        position = maker.embed(bent, np.random.default_rng(0)).position[0]
        return np.linalg.norm(procrustes(position, points).apply(position) - points, axis=1).max()

    assert residual(Smacof(linked=8, tolerance=1e-9)) < 0.05
    assert residual(Smacof()) > 0.5


@pytest.mark.parametrize("verlet", [False, True])
def test_two_masses_swing_as_the_damped_oscillator_does(verlet):
    """Stretch x of a spring between two masses of 1 kg: x'' = -2 k x - 2 c x', from rest."""
    k, c, stretch, length = 3.0, 0.6, 0.4, 2.0
    start = np.array([[[0.0, length + stretch], [0.0, 0.0]]])
    pair = 1 - np.eye(2)[None]

    def error(step_s):
        marks = np.arange(0, int(3 / step_s) + 1)[:, None]
        states = map_kernels.springs(
            length * pair, k * pair, c * pair, start, verlet, step_s, 1e-12, 4 * len(marks), marks
        )[4]
        t = step_s * marks[:, 0]
        omega = np.sqrt(2 * k - c**2)
        exact = stretch * np.exp(-c * t) * (np.cos(omega * t) + c / omega * np.sin(omega * t))
        swing = states[:, 0, 0, 1] - states[:, 0, 0, 0] - length
        assert np.allclose(states[:, 0, 0].mean(axis=1), start[0, 0].mean())  # their middle stays
        assert np.array_equal(states[:, 0, 1], np.zeros_like(states[:, 0, 1]))  # on their line
        return np.abs(swing - exact).max()

    assert error(0.001) < 0.004 * stretch
    assert 1.8 < error(0.004) / error(0.002) < 2.2  # first order: eq. 4, and the velocity of eq. 6, are a step late


def test_verlet_is_of_second_order_without_dampers():
    start, pair = np.array([[[0.0, 2.4], [0.0, 0.0]]]), 1 - np.eye(2)[None]

    def error(step_s):
        marks = np.arange(0, int(3 / step_s) + 1)[:, None]
        states = map_kernels.springs(2 * pair, 3 * pair, 1e-12 * pair, start, True, step_s, 0.0, len(marks), marks)[4]
        return np.abs(
            states[:, 0, 0, 1] - states[:, 0, 0, 0] - 2 - 0.4 * np.cos(np.sqrt(6) * step_s * marks[:, 0])
        ).max()

    assert error(0.01) < 1e-3
    assert 3.8 < error(0.02) / error(0.01) < 4.2


def places_on(position_m, signatures=None):
    """A map whose images look like where they were taken."""
    position_m = np.asarray(position_m, float)
    seen = position_m if signatures is None else signatures
    return Places(Signatures(np.float32(seen)), planar_poses(position_m), [str(i) for i in range(len(position_m))])


def grid(z=1.0):
    x, y = np.meshgrid(np.arange(6.0), np.arange(5.0))
    return np.stack([x.ravel(), y.ravel(), np.full(30, z)], axis=1)


@pytest.mark.parametrize("maker", MAKERS, ids=NAMES)
def test_a_query_between_the_places_is_found_where_it_is(maker):
    truth = np.random.default_rng(4).uniform([1, 1, 1.5], [4, 3, 1.5], (12, 3))
    index = maker.prepare(places_on(grid(1.5)), Euclidean())
    found = maker.locate(Signatures(np.float32(truth)), index)
    assert np.allclose(found.position_m, truth, atol=0.02)
    assert np.array_equal(found.place, found.field.argmin(axis=1))


def test_heights_are_the_mean_of_the_neighbours():
    position_m = grid()
    position_m[:, 2] = position_m[:, 0] / 10
    seen = np.column_stack([position_m[:, :2], np.zeros(30)])
    index = Smacof().prepare(places_on(position_m, seen), Euclidean())
    found = Smacof().locate(Signatures(np.float32([[2.0, 2.0, 0.0]])), index)
    assert np.allclose(found.position_m, [[2, 2, 0.2]], atol=1e-4)


def test_the_map_is_fitted_on_the_places_only():
    """A query that looks like nothing around it does not bend the map: its places stay where they are."""
    seen = np.column_stack([grid()[:, :2], np.zeros(30)])
    index = Smacof(neighbours=4).prepare(places_on(grid(), seen), Euclidean())
    far = Smacof(neighbours=4).locate(Signatures(np.float32([[2.4, 2.7, 2.0]])), index)
    plane = Smacof().embed(distances(np.array([[2.0, 2, 0], [3, 2, 0], [2, 3, 0], [3, 3, 0], [2.4, 2.7, 2]]))[None],
                             np.random.default_rng(0)).position[0]  # fmt: skip
    square = np.array([[2.0, 2], [3, 2], [2, 3], [3, 3]])
    assert np.allclose(far.position_m[0, :2], procrustes(plane[:4], square).apply(plane[4:])[0], atol=1e-4)


# ------------------------------------------------------------------------------------------------------- bad input
@pytest.mark.parametrize("maker", MAKERS, ids=NAMES)
def test_repeated_images_share_a_place(maker):
    points = np.random.default_rng(1).uniform(0, 1, (1, 8, 2))
    points[0, 5] = points[0, 2]
    made = maker.embed(distances(points), np.random.default_rng(0))
    assert np.abs(distances(made.position) - distances(points)).max() < 0.02


@pytest.mark.parametrize("maker", MAKERS, ids=NAMES)
def test_images_that_are_all_the_same_are_one_place_and_said(maker, caplog):
    made = maker.embed(np.zeros((1, 5, 5)), np.random.default_rng(0))
    assert np.abs(distances(made.position)).max() < 0.01
    assert "all distances equal" in caplog.text


@pytest.mark.parametrize("maker", MAKERS, ids=NAMES)
def test_places_on_a_line_are_said_to_mirror_the_query(maker, caplog):
    line = np.column_stack([np.arange(9.0), np.zeros(9), np.ones(9)])
    index = maker.prepare(places_on(line), Euclidean())
    found = maker.locate(Signatures(np.float32([[3.2, 0.5, 1.0]])), index)
    assert np.allclose(np.abs(found.position_m[0, :2]), [3.2, 0.5], atol=0.05)
    assert "1 of 1 queries have their neighbours on one line" in caplog.text


def test_distances_just_below_zero_are_zero():
    """Cosines of equal signatures come out a little above 1."""
    exact = distances(np.random.default_rng(1).uniform(0, 1, (1, 8, 2)))
    exact[0, 2] = exact[0, :, 2] = exact[0, 5]
    exact[0, 2, 5] = exact[0, 5, 2] = exact[0, 2, 2] = 0
    below = np.where(exact == 0, -1.2e-7, exact)
    made, other = (Smacof().embed(d, np.random.default_rng(0)).position for d in (exact, below))
    assert np.array_equal(made, other)


def test_places_at_one_position_answer_that_position():
    same = np.tile([1.0, 2.0, 3.0], (9, 1))
    seen = np.random.default_rng(0).uniform(0, 1, (9, 3))
    index = Smacof().prepare(places_on(same, seen), Euclidean())
    assert np.allclose(Smacof().locate(Signatures(np.float32(seen[:2])), index).position_m, same[:2])


def test_springs_that_fly_apart_are_run_again_with_a_smaller_step(caplog):
    points = np.random.default_rng(1).uniform(0, 1, (1, 40, 2))
    made = Spring(step_s=0.5).embed(distances(points), np.random.default_rng(0))
    assert made.stress[0] < 1e-2
    assert "flew apart with step_s=0.5 in 4 of 4 systems" in caplog.text


def test_springs_that_do_not_come_to_rest_are_said(caplog):
    Spring(iterations=3).embed(noisy(0), np.random.default_rng(0))
    assert "4 of 4 systems of springs were still moving after 3 iterations" in caplog.text


def test_springs_far_softer_than_their_dampers_creep_and_are_not_settled(caplog):
    Spring(constants=Constants.inverse_square, slope=1e-9, iterations=50, starts=2).embed(
        noisy(0), np.random.default_rng(0)
    )
    assert "2 of 2 systems of springs were still moving after 50 iterations" in caplog.text


def test_a_map_in_pieces_is_said(caplog):
    points = np.array([[[0.0, 0], [1, 0], [0, 1], [50, 0], [51, 0], [50, 1]]])
    made = Smacof(threshold=3.0).embed(distances(points), np.random.default_rng(0))
    assert np.allclose(distances(made.position[0, :3]), distances(points[0, :3]), atol=1e-3)
    assert "1 of 1 maps fall into parts that no distance holds together, up to 2;" in caplog.text


@pytest.mark.parametrize("maker", [Smacof(threshold=1e-9), Spring(threshold=1e-9)])
def test_a_threshold_that_leaves_no_pair_is_said(maker, caplog):
    made = maker.embed(noisy(0), np.random.default_rng(0))
    assert np.isfinite(made.position).all()
    assert made.stress[0] == 0
    assert "1 of 1 maps fall into parts" in caplog.text


def test_what_joins_all_points_is_connected():
    chain = np.eye(6, k=1, dtype=bool) | np.eye(6, k=-1, dtype=bool)
    cut = chain.copy()
    cut[2, 3] = cut[3, 2] = False
    assert np.array_equal(connected(np.stack([chain, cut])), [True, False])


@pytest.mark.parametrize("value", [np.nan, -1.0])
def test_distances_that_are_none_are_refused(value):
    given_ = noisy(0)
    given_[0, 1, 2] = value
    with pytest.raises(DataError, match="NaN or numbers below 0"):
        Smacof().embed(given_, np.random.default_rng(0))


def test_distances_of_two_points_are_refused():
    with pytest.raises(DataError, match="make no map"):
        Spring().embed(np.zeros((1, 2, 2)), np.random.default_rng(0))


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (lambda: Spring(neighbours=2), "neighbours=2"),
        (lambda: Spring(starts=0), "starts=0"),
        (lambda: Spring(step_s=-1), "step_s=-1"),
        (lambda: Smacof(threshold=0.0), "threshold=0"),
        (lambda: Smacof(linked=0), "linked=0"),
        (lambda: Smacof(tolerance=0.0), "tolerance=0"),
    ],
)
def test_settings_that_make_no_map_are_refused(make, what):
    with pytest.raises(ConfigError, match=what):
        make()


@pytest.mark.parametrize("maker", [Smacof(), Spring()])
def test_maps_too_small_or_without_positions_are_refused(maker):
    with pytest.raises(DataError, match=r"9 neighbours are more than the map's 4 places"):
        maker.prepare(places_on(grid()[:4]), Euclidean())
    with pytest.raises(DataError, match="no places"):
        maker.prepare(Places(Signatures(np.empty((0, 3), np.float32)), np.empty((0, 4, 4)), []), Cosine())
    with pytest.raises(DataError, match="have no positions"):
        maker.prepare(Places(Signatures(np.ones((9, 3), np.float32)), None, ["k"] * 9), Cosine())


@pytest.fixture(autouse=True)
def _warnings_are_kept(caplog):
    caplog.set_level(logging.WARNING, "omnilab")


def test_repeated_images_are_as_far_from_the_others_as_one_another():
    """A length of 0 joins two points: paths to a third lead over it."""
    from omnilab_appearance.localizers.smacof import complete_distances

    lengths = np.array([[[0.0, 0, 0], [0, 0, 3], [0, 3, 0]]])
    counts = np.array([[[False, True, False], [True, False, True], [False, True, False]]])
    assert complete_distances(lengths, counts)[0, 0, 2] == 3.0
