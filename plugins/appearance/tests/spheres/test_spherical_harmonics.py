"""Spherical harmonics and correlation on SO(3) against scipy, closed forms and exactly rotated spheres."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.special import eval_jacobi, factorial, sph_harm_y

from omnilab.api import Floats, Signatures
from omnilab.cameras import EquirectangularCamera, HyperbolicMirror, ImageCircle
from omnilab.cameras.sphere import resolution_rad, sphere, sphere_rows
from omnilab.errors import DataError
from omnilab.image import view_of
from omnilab.testing import check_descriptor, check_distance
from omnilab_appearance import So3Correlation, SphericalHarmonics, SphericalPower
from omnilab_appearance.common import spherical_harmonics as sh
from omnilab_appearance.common.so3_correlation import at_rotations, betas_of, correlate

LIMIT, ROWS = 8, 32
RNG = np.random.default_rng(7)
COEFFICIENTS = RNG.standard_normal((4, LIMIT**2)) / (1 + sh.degrees(LIMIT))
ROTATIONS = Rotation.random(4, random_state=3).as_matrix()
GREY_LEVELS = 100 / np.abs(sh.synthesis(COEFFICIENTS, ROWS, 2 * ROWS)).max()


def pictures(coefficients: Floats) -> Floats:
    values = 128 + GREY_LEVELS * sh.synthesis(coefficients, ROWS, 2 * ROWS)
    return np.clip(np.rint(values), 1, 255).astype(np.uint8)


def seen_rotated(R_place_query: Floats) -> Floats:
    """The functions as cameras see them that are rotated by R (n, 3, 3): coefficients of d -> f(R d)."""
    turned = sh.rotated(sh.unpacked_of(COEFFICIENTS), np.swapaxes(R_place_query, -1, -2))
    return sh.packed(turned[..., LIMIT - 1 :])


def angles_deg(A: Floats, B: Floats) -> Floats:
    return np.rad2deg(Rotation.from_matrix(np.swapaxes(A, -1, -2) @ B).magnitude())


def own_rotations(found) -> Floats:
    every = np.arange(len(ROTATIONS))
    return found.R_place_query[every, every]


def test_the_contracts():
    check_descriptor(SphericalPower())
    check_descriptor(SphericalPower(color=True))
    check_descriptor(SphericalHarmonics(band_limit=4))
    noise = RNG.standard_normal((8, LIMIT**2))
    check_distance(So3Correlation(), SphericalHarmonics(band_limit=4).describe(pictures(noise)), equivariant=False)


def test_coefficients_are_those_of_scipys_harmonics():
    theta, phi = np.pi * (np.arange(ROWS) + 0.5) / ROWS, np.pi * np.arange(2 * ROWS) / ROWS
    complexes = sh.unpacked_of(COEFFICIENTS[0])
    values = sum(
        complexes[l, m + LIMIT - 1] * sph_harm_y(l, m, theta[:, None], phi) for l in range(LIMIT) for m in range(-l, l + 1)
    )  # fmt: skip
    np.testing.assert_allclose(sh.synthesis(COEFFICIENTS[0], ROWS, 2 * ROWS), values.real, atol=1e-12)
    np.testing.assert_allclose(values.imag, 0, atol=1e-12)
    # the quadrature is exact up to a band limit of half the rows
    np.testing.assert_allclose(sh.analysis(values.real[::2, ::2], 4), sh.analysis(values.real, 4)[:16], atol=0.5)
    np.testing.assert_allclose(sh.analysis(values.real, LIMIT), COEFFICIENTS[0], atol=1e-12)


@settings(max_examples=25)
@given(st.integers(0, 24), st.floats(-7, 7), st.floats(-7, 7))
def test_wigners_d_is_orthogonal_and_a_representation(degree, a, b):
    first, second = sh.wigner_d(degree, np.array(a)), sh.wigner_d(degree, np.array(b))
    np.testing.assert_allclose(first @ first.T, np.eye(2 * degree + 1), atol=1e-12)
    np.testing.assert_allclose(first @ second, sh.wigner_d(degree, np.array(a + b)), atol=1e-11)


def test_wigners_d_is_that_of_jacobis_polynomials():
    """d^l_mm' for m >= |m'| (Varshalovich et al., 1988, 4.3.4), at a degree where factorials are still exact enough."""
    l, beta = 9, 0.8
    d = sh.wigner_d(l, np.array(beta))
    for m in range(l + 1):
        for n in range(-m, m + 1):
            scale = np.sqrt(factorial(l + m) * factorial(l - m) / factorial(l + n) / factorial(l - n))
            powers = np.sin(beta / 2) ** (m - n) * np.cos(beta / 2) ** (m + n)
            value = (-1) ** (m - n) * scale * powers * eval_jacobi(l - m, m - n, m + n, np.cos(beta))
            assert d[l + m, l + n] == pytest.approx(value, abs=1e-11)


def test_wigners_functions_are_orthogonal_over_so3():
    """The integral of d^l d^k sin(beta) over beta is 2 / (2 l + 1) where l = k, else 0 (Peter and Weyl)."""
    x, weights = np.polynomial.legendre.leggauss(20)
    d = {l: sh.wigner_d(l, np.arccos(x)) for l in (2, 3, 6)}
    for l, one in d.items():
        for k, other in d.items():
            inner = np.einsum("b,b,b->", weights, one[:, l + 1, l - 2], other[:, k + 1, k - 2])
            assert inner == pytest.approx(2 / (2 * l + 1) if l == k else 0, abs=1e-12)


def test_a_rotation_of_the_sphere_rotates_its_coefficients_and_keeps_its_power():
    directions = RNG.standard_normal((5, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)

    def values(complexes: sh.Complexes, d: Floats) -> Floats:
        theta, phi = np.arccos(d[:, 2]), np.arctan2(d[:, 1], d[:, 0])
        return sum(
            (complexes[l, m + LIMIT - 1] * sph_harm_y(l, m, theta, phi)).real for l in range(LIMIT) for m in range(-l, l + 1)
        )  # fmt: skip

    complexes = sh.unpacked_of(COEFFICIENTS)
    for R, before, after in zip(ROTATIONS, complexes, sh.rotated(complexes, ROTATIONS), strict=True):
        np.testing.assert_allclose(values(after, directions), values(before, directions @ R), atol=1e-12)
    np.testing.assert_allclose(sh.power(seen_rotated(ROTATIONS)), sh.power(COEFFICIENTS), rtol=1e-12)


@settings(max_examples=30)
@given(st.floats(-10, 10), st.floats(0, np.pi), st.floats(-10, 10))
def test_euler_angles_and_back(alpha, beta, gamma):
    R = sh.rotation_zyz(*(np.array(angle) for angle in (alpha, beta, gamma)))
    np.testing.assert_allclose(sh.rotation_zyz(*sh.zyz_of(R)), R, atol=1e-11)


def test_the_transform_over_so3_is_the_correlation_at_each_rotation():
    one, *others = sh.unpacked_of(COEFFICIENTS)
    betas = betas_of(LIMIT)
    found = correlate(one, np.array(others), betas)
    for k, i, j in RNG.integers(0, [len(betas), 2 * LIMIT, 2 * LIMIT], (6, 3)):
        R = sh.rotation_zyz(np.array(np.pi * i / LIMIT), betas[k], np.array(np.pi * j / LIMIT))
        for p, other in enumerate(others):
            turned = sh.synthesis(sh.packed(sh.rotated(other[None], R[None])[..., LIMIT - 1 :])[0], ROWS, 2 * ROWS)
            product = sh.analysis(sh.synthesis(COEFFICIENTS[0], ROWS, 2 * ROWS) * turned, 1)[0] * np.sqrt(4 * np.pi)
            assert found[p, k, i, j] == pytest.approx(product, abs=1e-10)
            assert found[p, k, i, j] == pytest.approx(at_rotations(one, other, R[None])[0], abs=1e-10)


def test_rotated_spheres_are_recovered_to_the_grid_and_refined_below_a_tenth_of_a_degree():
    harmonics = SphericalHarmonics(band_limit=12)
    places, queries = harmonics.describe(pictures(COEFFICIENTS)), harmonics.describe(pictures(seen_rotated(ROTATIONS)))
    coarse, fine = (So3Correlation(refined=n) for n in (0, 1))
    of_grid, match = coarse.match(queries, coarse.prepare(places)), fine.match(queries, fine.prepare(places))
    # half a step of 15 degrees along each of three angles, alpha and gamma about axes that are near each other at worst
    assert angles_deg(own_rotations(of_grid), ROTATIONS).max() < 15
    assert angles_deg(own_rotations(match), ROTATIONS).max() < 0.1
    assert (match.distance.argmin(axis=1) == np.arange(4)).all()
    assert match.distance.diagonal().max() < 1e-3
    power = SphericalPower(degrees=7)
    before, after = (power.describe(pictures(c)).place for c in (COEFFICIENTS, seen_rotated(ROTATIONS)))
    np.testing.assert_allclose(after, before, atol=0.01)  # rounding to grey levels
    assert np.abs(before[0] - before[1]).max() > 0.1


def test_a_mirrors_tilt_is_found_in_what_both_see():
    """A cap of the sphere is not seen, and it tilts: Pearson's correlation over the overlap alone."""
    tilts = Rotation.from_rotvec(np.deg2rad([[8, 3, 40], [-5, 9, 170], [0, 12, 0], [6, -6, -75]])).as_matrix()
    seen = (np.arange(ROWS) > 0.3 * ROWS)[:, None]
    harmonics = SphericalHarmonics(band_limit=12)
    places, queries = (harmonics.describe(pictures(c) * seen) for c in (COEFFICIENTS, seen_rotated(tilts)))
    distance = So3Correlation(largest_tilt_deg=20)
    match = distance.match(queries, distance.prepare(places))
    assert angles_deg(own_rotations(match), tilts).max() < 0.5
    assert (match.distance.argmin(axis=1) == np.arange(4)).all()
    heading = match.rotation_rad.diagonal()
    np.testing.assert_allclose(np.rad2deg(heading), [40, 170, 0, -75], atol=1)


def test_no_answer_tilts_more_than_it_may():
    turned = Rotation.from_euler("z", [[20], [-133], [90.5], [7]], degrees=True).as_matrix()
    harmonics, distance = SphericalHarmonics(band_limit=12), So3Correlation(largest_tilt_deg=0)
    index = distance.prepare(harmonics.describe(pictures(COEFFICIENTS)))
    upright = distance.match(harmonics.describe(pictures(seen_rotated(turned))), index)
    assert angles_deg(own_rotations(upright), turned).max() < 0.1
    leaning = distance.match(harmonics.describe(pictures(seen_rotated(ROTATIONS))), index)
    np.testing.assert_allclose(leaning.R_place_query[..., 2, 2], 1, atol=1e-12)
    some = So3Correlation(largest_tilt_deg=10).match(harmonics.describe(pictures(seen_rotated(ROTATIONS))), index)
    assert np.rad2deg(np.arccos(some.R_place_query[..., 2, 2])).max() < 10 + 1e-6


def test_gain_and_offset_of_the_light_change_nothing():
    harmonics = SphericalHarmonics(band_limit=LIMIT)
    first = harmonics.describe(pictures(COEFFICIENTS)).place
    dimmed = harmonics.describe((pictures(COEFFICIENTS) // 2 + 20).astype(np.uint8)).place
    np.testing.assert_allclose(dimmed, first, atol=0.03 * np.abs(first).max())


def test_a_sphere_is_what_an_equirectangular_camera_sees_and_no_finer():
    camera = EquirectangularCamera(128, 64, start_deg=180.0, clockwise=True)
    assert np.rad2deg(resolution_rad(camera)) == pytest.approx(180 / 64, rel=0.01)
    assert (sphere_rows(camera), sphere_rows(EquirectangularCamera(2048, 1024))) == (64, 256)
    picture = RNG.integers(0, 256, (1, 64, 128), dtype=np.uint8)
    np.testing.assert_array_equal(sphere(picture, camera)[0], np.roll(picture[0][:, ::-1], 65, axis=1))


def test_what_a_mirror_does_not_show_is_black():
    mirror = HyperbolicMirror(250, crop=1.0)
    found = view_of(np.full((1, 250, 250), 9, np.uint8), mirror, "sphere", False)[0]
    elevation = np.deg2rad(90 - 180 * (np.arange(len(found)) + 0.5) / len(found))
    low, high = mirror.elevations_rad
    within = (elevation > low + 0.05) & (elevation < high - 0.05)
    assert (found[within] == 9).all()
    assert (found[(elevation < low - 0.05) | (elevation > high + 0.05)] == 0).all()


def test_a_band_limit_above_what_the_picture_resolves_is_refused_in_a_sentence():
    coarse = np.full((1, 24, 48), 9, np.uint8)
    with pytest.raises(
        DataError, match=r"a band limit of 16 needs a sphere of 32 rows, and the camera resolves 24; give at"
    ):
        SphericalHarmonics().describe(coarse)
    assert SphericalHarmonics(band_limit=12).describe(coarse).place.shape == (1, 3, 144)  # the advice works
    with pytest.raises(DataError, match="is no sphere; give one twice as wide as high"):
        SphericalPower().describe(coarse[:, :, :40])
    with pytest.raises(DataError, match="ImageCircle does not know where its pixels look"):
        view_of(coarse, ImageCircle(48, 24, HyperbolicMirror(24).circle), "sphere", False)
    distance = So3Correlation()
    with pytest.raises(DataError, match=r"are no spherical harmonics; choose descriptor=spherical_harmonics"):
        distance.prepare(Signatures(np.zeros((2, 3, 7), np.float32)))
    with pytest.raises(DataError, match=r"queries of band limit 2 cannot be compared with places of 3"):
        distance.match(
            Signatures(np.zeros((2, 3, 4), np.float32)), distance.prepare(Signatures(np.zeros((2, 3, 9), np.float32)))
        )
