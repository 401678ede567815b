"""Rotational PCA against an ordinary PCA of all rotated copies."""

from __future__ import annotations

import numpy as np
import pytest

from omnilab.api import Signatures
from omnilab.errors import ConfigError, DataError
from omnilab.testing import check_descriptor
from omnilab_appearance import Cityblock, Euclidean, RotationalPca
from omnilab_appearance.descriptors.rotational_pca import Projections

RNG = np.random.default_rng(6)
PANORAMAS = RNG.integers(0, 256, (5, 8, 48), dtype=np.uint8)
PCA = RotationalPca(components=6, rotations=12, rows=8)


def test_the_contract():
    check_descriptor(RotationalPca())
    check_descriptor(RotationalPca(color=True, components=4))
    check_descriptor(RotationalPca(components=4, projections=Projections.complex))


def test_eigenvalues_are_those_of_all_rotated_copies():
    space = PCA.fit(PANORAMAS)
    copies = np.stack([np.roll(p, r * 4, axis=1).ravel() for p in PANORAMAS.astype(float) for r in range(12)])
    copies -= copies.mean(0)
    reference = np.linalg.svd(copies, compute_uv=False)
    # frequencies other than 0 and N_R / 2 stand for themselves and their conjugates
    ours = np.repeat(space.singular, np.where(np.isin(space.frequencies, (0, 6)), 1, 2))
    np.testing.assert_allclose(np.sort(ours)[::-1] * np.sqrt(12), reference[: len(ours)], rtol=1e-4)


def test_with_all_components_projections_keep_all_distances_at_one_frequency():
    """Moduli of projections on a full basis have the length of the centred image."""
    space = RotationalPca(components=100, rotations=12, rows=8).fit(PANORAMAS)
    place = space.describe(PANORAMAS).place
    twice = np.where(np.isin(space.frequencies, (0, 6)), 1, 2)
    centred = PANORAMAS - PANORAMAS.reshape(5, 8, 12, 4).astype(float).mean((0, 2))[None, :, None].repeat(
        12, 2
    ).reshape(1, 8, 48)
    np.testing.assert_allclose((twice * place**2).sum(1), (centred**2).sum((1, 2)), rtol=1e-4)


@pytest.mark.parametrize("steps", range(12))
def test_a_turn_keeps_places_and_shifts_headings(steps):
    space = PCA.fit(PANORAMAS)
    before, after = space.describe(PANORAMAS), space.describe(np.roll(PANORAMAS, -4 * steps, axis=2))
    np.testing.assert_allclose(after.place, before.place, rtol=1e-3, atol=1e-2)
    np.testing.assert_allclose(after.heading, np.roll(before.heading, -steps, axis=-1), rtol=1e-3, atol=1e-2)
    match = Cityblock().match(after, Cityblock().prepare(before))
    assert (match.distance.argmin(1) == np.arange(5)).all()
    error = np.angle(np.exp(1j * (match.rotation_rad.diagonal() - 2 * np.pi * steps / 12)))
    assert np.abs(error).max() < np.pi / 12


def test_complex_projections_are_those_on_eigenvectors_of_all_rotated_copies():
    """Their lengths and differences are those of projections on NumPy's eigenvectors of the copies' covariance."""
    space = RotationalPca(components=6, rotations=12, rows=8, projections=Projections.complex).fit(PANORAMAS)
    place = space.describe(PANORAMAS).place
    assert place.shape == (5, 12)
    place = place.reshape(5, 6, 2)
    copies = np.stack([np.roll(p, r * 4, axis=1).ravel() for p in PANORAMAS.astype(float) for r in range(12)])
    mean = copies.mean(0)
    values, vectors = np.linalg.eigh((copies - mean).T @ (copies - mean))
    order = np.argsort(-values)
    single = np.isin(space.frequencies, (0, 6))  # the others share an eigenvalue with their conjugates: a plane each
    ends = np.cumsum(np.where(single, 1, 2))
    for i, (end, size) in enumerate(zip(ends, np.where(single, 1, 2), strict=True)):
        reference = (PANORAMAS.reshape(5, -1) - mean) @ vectors[:, order[end - size : end]]  # (5, size), real
        gaps = np.linalg.norm(reference[:, None] - reference, axis=2) / np.sqrt(size)
        np.testing.assert_allclose(np.linalg.norm(place[:, None, i] - place[:, i], axis=2), gaps, rtol=1e-3, atol=0.05)


def test_complex_projections_on_a_full_basis_keep_distances_between_images():
    space = RotationalPca(components=100, rotations=12, rows=8, projections=Projections.complex).fit(PANORAMAS)
    signatures = space.describe(PANORAMAS)
    weighted = Signatures(signatures.place * np.sqrt(np.where(np.isin(space.frequencies, (0, 6)), 1, 2)).repeat(2))
    found = Euclidean().match(weighted, Euclidean().prepare(weighted)).distance
    images = PANORAMAS.reshape(5, -1).astype(float)
    np.testing.assert_allclose(found, np.linalg.norm(images[:, None] - images, axis=2), rtol=1e-3, atol=1)


@pytest.mark.parametrize("steps", range(1, 12))
def test_a_turn_changes_complex_projections_by_phases_alone(steps):
    space = RotationalPca(components=6, rotations=12, rows=8, projections=Projections.complex).fit(PANORAMAS)
    before, after = (
        space.describe(image).place.reshape(5, -1, 2) @ np.array([1, 1j])
        for image in (PANORAMAS, np.roll(PANORAMAS, -4 * steps, axis=2))
    )
    phases = np.exp(2j * np.pi * space.frequencies * steps / 12)
    np.testing.assert_allclose(after, before * phases, rtol=1e-3, atol=0.05)
    np.testing.assert_array_equal(PCA.fit(PANORAMAS).describe(PANORAMAS).place, np.abs(before.astype(np.complex64)))


def test_an_eigenspace_is_saved_and_loaded(tmp_path):
    space = PCA.fit(PANORAMAS)
    space.save(tmp_path / "space.npz")
    loaded = RotationalPca(components=6, rotations=12, rows=8, basis=str(tmp_path / "space.npz"))
    assert loaded.fit(PANORAMAS) is loaded
    mine, theirs = space.describe(PANORAMAS), loaded.describe(PANORAMAS)
    np.testing.assert_array_equal(mine.place, theirs.place)
    np.testing.assert_array_equal(mine.heading, theirs.heading)
    with pytest.raises(ConfigError, match=r"was fitted with rotations=12, not 24; give descriptor.rotations=12"):
        RotationalPca(rotations=24, rows=8, basis=str(tmp_path / "space.npz")).describe(PANORAMAS)
    with pytest.raises(DataError, match="another size"):
        loaded.describe(np.zeros((1, 8, 96), np.uint8))


def test_what_holds_no_eigenspace(tmp_path):
    for name, write in (("absent.npz", None), ("text.npz", b"hello"), ("other.npz", "npz")):
        file = tmp_path / name
        if write == "npz":
            np.savez(file, mean=np.zeros(3))
        elif write:
            file.write_bytes(write)
        with pytest.raises(DataError, match="holds no eigenspace"):
            RotationalPca(basis=str(file)).describe(PANORAMAS)
    np.savez(
        tmp_path / "pickled.npz", mean=np.array([object()]), vectors=0, frequencies=0, singular=0, rotations=0, rows=0
    )
    with pytest.raises(DataError, match="holds no eigenspace"):
        RotationalPca(basis=str(tmp_path / "pickled.npz")).describe(PANORAMAS)


def test_it_must_be_fitted_first():
    with pytest.raises(DataError, match="fit it on the map's panoramas first, or give a basis"):
        PCA.describe(PANORAMAS)


def test_black_maps_have_an_eigenspace():
    black = np.zeros_like(PANORAMAS)
    found = PCA.fit(black).describe(black)
    assert np.isfinite(found.place).all()
    assert np.isfinite(
        Cityblock().match(found, Cityblock().prepare(Signatures(found.place, found.heading))).distance
    ).all()


@pytest.mark.parametrize("settings", [{"components": 0}, {"rotations": 0}, {"rotations": 7}, {"rows": 0}])
def test_settings_that_span_nothing(settings):
    with pytest.raises(ConfigError, match=f"{next(iter(settings))}=. is out of range"):
        RotationalPca(**settings)


def test_rotations_that_do_not_fit():
    with pytest.raises(DataError, match="10 rotations do not divide panoramas of 48 columns"):
        RotationalPca(rotations=10, rows=8).fit(PANORAMAS)
