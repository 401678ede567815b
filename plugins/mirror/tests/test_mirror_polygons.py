"""Polygons of mesh files become triangles of the same area, whatever their shape."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnilab_mirror.scene.meshes.polygons import split


def shoelace(polygon: np.ndarray) -> float:
    """The area inside corners (n, 2)."""
    x, y = polygon.T
    return abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))) / 2


def turned(rng: np.random.Generator, polygon: np.ndarray) -> np.ndarray:
    """Corners (n, 3) of a polygon (n, 2) somewhere in space."""
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return polygon @ axes[:2] + rng.normal(size=3) * 10


def pieces(polygons: list[np.ndarray]):
    """Areas (T,), polygons (T,) and normals (T, 3) of the triangles, and how many polygons cross themselves."""
    points, counts = np.concatenate(polygons), np.array([len(polygon) for polygon in polygons])
    found = split(points, np.arange(len(points)), counts)
    a, b, c = found.of_corners(points).swapaxes(0, 1)
    with np.errstate(invalid="ignore", over="ignore"):
        normals = np.cross(b - a, c - a) / 2
    return np.linalg.norm(normals, axis=1), found.of_polygons(np.arange(len(polygons))), normals, found.crossing


def flat(corners) -> np.ndarray:
    corners = np.asarray(corners, float)
    return np.column_stack([corners, np.zeros(len(corners))])


L = [(0, 0), (6, 0), (6, 2), (2, 2), (2, 6), (0, 6)]
FRAME = [
    (0, 0),
    (6, 0),
    (6, 6),
    (0, 6),
    (0, 0),
    (2, 2),
    (2, 4),
    (4, 4),
    (4, 2),
    (2, 2),
]  # joined to its hole by a bridge
COMB = [(0, 0), *((2 * k + x, y) for k in range(9) for x, y in ((0, 10), (1, 1))), (18, 0)][::-1]


@pytest.mark.parametrize(
    ("corners", "area"),
    [
        (L, 20),
        (L[::-1], 20),
        (L[3:] + L[:3], 20),
        (FRAME, 32),
        (COMB, shoelace(np.array(COMB, float))),
        ([(0, 0), (4, 0), (1, 1), (0, 4)], 4),  # an arrow, whose first diagonal lies outside
        ([(4, 0), (1, 1), (0, 4), (0, 0)], 4),
        ([(0, 0), (1, 0), (2, 0), (2, 2), (0, 2)], 4),  # a corner on a straight edge
        ([(0, 0), (1, 0), (1, 0), (2, 2), (0, 2), (0, 0)], 3),  # corners twice
        ([(0, 0), (2, 0), (2, 2), (0, 2)], 4),
        ([(0, 0), (3, 0), (0, 3)], 4.5),
    ],
)
def test_areas_are_exact(corners, area):
    areas, _, normals, crossing = pieces([flat(corners)])
    assert areas.sum() == pytest.approx(area, rel=1e-12)
    assert crossing == 0
    assert np.all(areas > 0)  # corners on straight edges leave no slivers behind
    assert np.abs(normals.sum(axis=0)[2]) == pytest.approx(area, rel=1e-12)  # none is turned over


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_random_polygons_in_space_keep_their_area(seed):
    rng = np.random.default_rng(seed)
    polygons, areas = [], []
    for _ in range(rng.integers(1, 8)):
        n = int(rng.integers(3, 24))
        angle = np.sort(rng.uniform(0, 2 * np.pi, n))
        shape = rng.uniform(0.2, 3, n)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        if np.max(np.diff([*angle, angle[0] + 2 * np.pi])) > 3:  # its middle would lie outside, and edges might cross
            continue
        polygons.append(turned(rng, shape[:: rng.choice([-1, 1])]))
        areas.append(shoelace(shape))
    if polygons:
        found, polygon, _, crossing = pieces(polygons)
        assert crossing == 0
        assert np.allclose(np.bincount(polygon, found, len(areas)), areas, rtol=1e-9, atol=1e-12)
        assert np.all(np.diff(polygon) >= 0)


@pytest.mark.parametrize(
    "corners",
    [
        [(0, 0), (2, 2), (2, 0), (0, 2)],  # a bow tie, with no area by its outline
        [(0, 0), (4, 3), (4, 0), (0, 2)],
        [(np.cos(a), np.sin(a)) for a in np.arange(5) * 4 * np.pi / 5],  # a star of five strokes
    ],
)
def test_polygons_that_cross_themselves_are_counted_and_shown_as_fans(corners):
    areas, _, _, crossing = pieces([flat(corners), flat(L)])
    assert crossing == 1
    assert len(areas) == len(corners) - 2 + 4


def test_a_polygon_of_too_many_corners_is_counted_if_it_is_not_convex():
    angle = np.linspace(0, 2 * np.pi, 6000, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    assert pieces([flat(circle)])[3] == 0
    assert pieces([flat(circle * np.where(np.arange(6000) % 2, 1, 0.5)[:, None])])[3] == 1


def test_lines_points_and_numbers_that_are_none_end_well():
    areas, polygon, _, crossing = pieces([
        flat([(0, 0), (1, 0), (2, 0), (3, 0)]),
        flat([(1, 1)] * 5),
        flat([(0, 0), (1, 0)]),
        flat([(0, 0), (np.nan, 0), (1, 1), (0, 1)]),
        flat([(0, 0), (1e300, 0), (1e300, 1e300), (0, 1e300)]),
    ])  # fmt: skip
    assert crossing == 0
    assert set(polygon.tolist()) == {0, 1, 3, 4}
    assert areas[polygon < 2].sum() == 0
