"""Lamps and their shadows, against closed forms and brute force."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnilab_mirror.render.light_baking import brightness_of
from omnilab_mirror.render.prepared_world import baked_pictures
from omnilab_mirror.render.shadows import LIFT_M
from omnilab_mirror.scene.light import Illumination, Lamp
from omnilab_mirror.scene.load import load_world
from omnilab_mirror.scene.quads import Quad
from omnilab_mirror.scene.textures.canvas import Paint

GREY = Paint(lambda canvas: canvas.filled([100.0, 100.0, 100.0]))
LANTERN = Paint(GREY.painter, glows=True)


def level(x, y, z, width, depth, paint=GREY):
    """A quad that faces up, around (x, y)."""
    return Quad(np.array([x - width / 2, y - depth / 2, z]), np.array([width, 0, 0]), np.array([0, depth, 0]), paint)


def lattice(face, shape):
    """Its points (rows, columns, 3)."""
    rows, columns = shape
    x, y = (np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows
    return face.corner + x[None, :, None] * face.u + y[:, None, None] * face.v


def lambert(lamp, points, normal):
    """power cos / (1 + (d / reach)^2)."""
    ray = lamp.at - points
    distance = np.linalg.norm(ray, axis=-1)
    return lamp.power * np.maximum(0, ray @ normal) / distance / (1 + (distance / lamp.reach_m) ** 2)


def test_a_board_throws_the_shadow_that_similar_triangles_give():
    lamp = Lamp(np.array([0, 0, 3.0]), 0.8, 2.0)
    floor, board = level(0, 0, 0, 4, 4), level(0.2, 0.1, 1.5, 0.6, 0.4)
    brightness = brightness_of(Illumination(0.3, [lamp]), [floor, board], 0.05)[0]
    points = lattice(floor, brightness.shape)
    # at half the lamp's height, the board is projected to twice its size and offset
    dx, dy = np.abs(points[..., 0] - 0.4) - 0.6, np.abs(points[..., 1] - 0.2) - 0.4
    inside, sure = np.maximum(dx, dy) < 0, np.abs(np.maximum(dx, dy)) > 0.02
    lit = 0.3 + lambert(lamp, points, np.array([0, 0, 1]))
    assert inside.sum() > 300
    assert np.allclose(brightness[inside & sure], 0.3)
    assert np.allclose(brightness[~inside & sure], lit[~inside & sure])


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 25))
def test_points_are_lit_where_no_face_is_in_the_way(seed, count):
    rng = np.random.default_rng(seed)
    faces = [Quad(*rng.normal(size=(3, 3)) * [[2], [0.7], [0.7]], GREY) for _ in range(count)]
    lamp = Lamp(rng.normal(size=3) * 2, 1.0, 2.0)
    for face, brightness in zip(faces, brightness_of(Illumination(0.0, [lamp]), faces, 0.2), strict=True):
        normal = np.cross(face.u, face.v) / np.linalg.norm(np.cross(face.u, face.v))
        points = lattice(face, brightness.shape)
        start = points + LIFT_M * normal
        free, sure = np.ones(brightness.shape, bool), np.ones(brightness.shape, bool)
        for other in faces:
            if other is face:
                continue
            A = np.stack(np.broadcast_arrays(lamp.at - start, -other.u, -other.v), -1)
            hit = np.linalg.solve(A, (other.corner - start)[..., None])[..., 0]
            margin = np.minimum(hit, 1 - hit).min(axis=-1)
            free &= margin < 0
            sure &= np.abs(margin) > 1e-6
        expected = np.where(free, lambert(lamp, points, normal), 0)
        assert np.allclose(brightness[sure], expected[sure], atol=1e-9)


def test_a_wide_lamp_s_shadow_has_a_soft_edge_as_wide_as_its_disc_projected():
    lamp = Lamp(np.array([0, 0, 2.0]), 1.0, 100.0, radius_m=0.2)
    floor, board = level(0, 0, 0, 2, 2), level(-5, 0, 1.0, 10, 10)  # its edge hangs at x = 0, half way
    soft, hard = (
        brightness_of(Illumination(0.0, [light]), [floor, board], 0.02)[0][50]
        for light in (lamp, Lamp(lamp.at, 1.0, 100.0))
    )
    x = (np.arange(100) - 49.5) * 0.02
    share = soft / np.maximum(hard.max(), 1e-9)
    assert np.all(soft[x < -0.22] == 0)
    assert np.allclose(share[(x > 0.22) & (x < 0.4)], hard[(x > 0.22) & (x < 0.4)] / hard.max(), rtol=0.02)
    assert np.all(np.diff(soft[np.abs(x) < 0.2]) > -0.002)  # but for the cosine
    assert share[np.abs(x) < 0.02].mean() == pytest.approx(0.5, abs=0.1)


def test_lanterns_let_their_lamp_s_light_out_and_shadows_can_be_left_off():
    lamp, floor = Lamp(np.array([0, 0, 2.0]), 1.0, 2.0), level(0, 0, 0, 2, 2)
    alone = brightness_of(Illumination(0.1, [lamp]), [floor], 0.1)[0]
    lantern, board = level(0, 0, 1.9, 0.5, 0.5, LANTERN), level(0, 0, 1.9, 0.5, 0.5)
    assert np.array_equal(brightness_of(Illumination(0.1, [lamp]), [floor, lantern], 0.1)[0], alone)
    assert np.array_equal(brightness_of(Illumination(0.1, [lamp], shadows=False), [floor, board], 0.1)[0], alone)
    assert np.allclose(brightness_of(Illumination(0.1, [lamp]), [floor, board], 0.1)[0], 0.1)


def test_an_empty_room_has_neither_leaks_nor_dark_seams(write):
    text = "map_m: [1, 1]\ntexels_per_m: 50\nlight: {ambient: 0.2, lamps: [{at: [0.5, 0.2, 1.5], radius_m: 0.1}]}\nobjects:\n"
    room = "  - {kind: room, size: [4, 3, 2.5]}\n  - {kind: rug, at: [0, 0], size: [1, 1]}\n"
    room += "  - {kind: panel, wall: north, at: [0, 1], size: [1, 1]}\n"
    shaded, plain = (
        load_world(write(text.replace("lamps", f"shadows: {on}, lamps") + room)) for on in ("true", "false")
    )
    for one, other in zip(baked_pictures(shaded), baked_pictures(plain), strict=True):
        assert np.abs(one.astype(int) - other).max() <= 1


def test_nothing_shines_through_a_wall(write):
    text = "map_m: [1, 1]\ntexels_per_m: 50\nlight: {ambient: 0, lamps: [{at: [-1, 0, 1.5], power: 5}]}\nobjects:\n"
    text += "  - {kind: room, size: [4, 4, 2.5], floor: [200, 200, 200]}\n"
    text += "  - {kind: wall, from: [0, -2], to: [0, 2], height: 2.5}\n"
    floor = baked_pictures(load_world(write(text)))[0]
    assert floor[:, 108:].max() == 0
    assert floor[:, :90].min() > 20
