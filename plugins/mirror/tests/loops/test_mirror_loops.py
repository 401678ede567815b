"""Loops over large meshes against what they stand for: numpy, embreex and lines of OBJ read one by one, bit for bit."""

from __future__ import annotations

import gc
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from hypothesis import given, settings
from hypothesis import strategies as st

from omnilab_mirror.render.embree_tree import LANES, Tree
from omnilab_mirror.scene.meshes import obj
from omnilab_mirror.scene.meshes.corners import extent, is_padded, moved, normals_of, padded, placed, rows_at
from omnilab_mirror.scene.meshes.mesh_materials import MeshMaterials
from omnilab_mirror.scene.meshes.obj_scan import scanned
from omnilab_mirror.scene.meshes.triangles import joined

RNG = np.random.default_rng(5)
CORNERS = (RNG.normal(size=(3000, 1, 3)) * 3 + RNG.normal(size=(3000, 3, 3))).astype(np.float32)


@pytest.mark.parametrize("count", [0, 1, LANES - 1, LANES + 1, 20_001])
def test_packets_meet_what_single_rays_meet(count):
    rng = np.random.default_rng(count)
    origin, direction = (rng.normal(size=(count, 3)).astype(np.float32) for _ in range(2))
    scene = EmbreeScene()
    TriangleMesh(scene, CORNERS[:200])
    one = scene.run(origin, direction, output=1)
    triangle, distance = Tree(CORNERS[:200]).meet(origin, direction)
    assert np.array_equal(triangle, one["primID"])
    assert np.array_equal(distance[triangle >= 0], one["tfar"][triangle >= 0])
    assert count < 1000 or 0 < np.mean(triangle >= 0) < 1


def test_a_tree_reads_padded_corners_where_they_are_and_lives_as_long_as_it_is_held():
    corners = padded((2, 3, 3))
    corners[:] = CORNERS[:2]
    assert is_padded(corners)
    assert is_padded(CORNERS[:-1])
    assert not is_padded(CORNERS)
    assert not is_padded(corners[:, ::-1])
    tree = Tree(corners)
    middle, expected = CORNERS[1].mean(axis=0), CORNERS[1]
    corners = None
    gc.collect()
    normal = np.cross(expected[1] - expected[0], expected[2] - expected[0])
    triangle, _ = tree.meet((middle - normal)[None], normal[None])
    assert triangle.tolist() == [1]


def test_loops_over_corners_are_what_numpy_computes():
    a, b, c = CORNERS.swapaxes(0, 1)
    normals, lengths = normals_of(CORNERS)
    assert np.array_equal(normals, np.cross(b - a, c - a))
    assert np.array_equal(lengths, np.linalg.norm(normals, axis=1))
    found, finite = extent(CORNERS)
    assert finite
    assert np.array_equal(found, [CORNERS.min(axis=(0, 1)), CORNERS.max(axis=(0, 1))])
    for bad in (np.nan, np.inf, -np.inf):
        broken = CORNERS[:5].copy()
        broken[3, 1, 2] = bad
        assert not extent(broken)[1]
    points, index = RNG.normal(size=(50, 3)) * 1e6, RNG.integers(0, 50, (200, 3))
    assert np.array_equal(placed(points, index, points[0]), (points[index] - points[0]).astype(np.float32))
    colors, out = RNG.integers(0, 256, (50, 3), np.uint8), np.empty((200, 3, 3), np.uint8)
    rows_at(colors, index, out)
    assert np.array_equal(out, colors[index])


@pytest.mark.parametrize("matrix", [
    np.eye(3), np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), 0.0254 * np.eye(3), np.linalg.qr(RNG.normal(size=(3, 3)))[0],
], ids=["moved", "y up", "scaled", "turned"])  # fmt: skip
def test_corners_move_as_by_a_product_of_matrices(matrix):
    at = np.array([0.3, -17.0, 0.0])
    with_zeros = np.where(np.abs(CORNERS) < 0.2, np.float32(-0.0), CORNERS)
    expected = (with_zeros @ matrix.T + at).astype(np.float32)
    assert np.array_equal(moved(with_zeros, matrix, at).view(np.int32), expected.view(np.int32))


# ------------------------------------------------------------------------------------------------------------- OBJ
NUMBERS = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    st.floats(-1e4, 1e4).map(lambda x: f"{x:.6f}"),
    st.integers(-(10**18), 10**18).map(str),
    st.sampled_from(
        ["1.", "-.5", "+2e-3", "0.1E+2", "9007199254740993", "1e23", "-0", "4.35", "0.000000000000000000001"]
    ),
)
ODD = st.sampled_from(
    ["v 1 2", "v nan 0 0", "f 0 1 2", "f a", "v 1 2 3 4", "vt 0.5", "v 1_0 2 3", "\x0bv 1 2 3", "f 1 2 3 \\", "f"]
)
ORDINARY = st.sampled_from(["# text", "", "g a", "o b", "usemtl m", "vn 0 0 1", "s off", "vp 1", "l 1 2"])


@st.composite
def obj_lines(draw):
    lines = [" ".join(["v", *draw(st.lists(NUMBERS, min_size=3, max_size=3))]) for _ in range(4)]
    lines += [" ".join(["vt", *draw(st.lists(NUMBERS, min_size=2, max_size=3))]) for _ in range(2)]
    corner = st.sampled_from(["1", "2", "3/1", "4/2", "1/2/1", "2//1", "-1", "-2/-1", "-3//-1", "4/"])
    for kind in draw(st.lists(st.sampled_from("fffov"), max_size=8)):
        if kind == "f":
            lines.append(
                " ".join(["f", *draw(st.lists(corner, min_size=3, max_size=5))]) + draw(st.sampled_from(["", " "]))
            )
        else:
            lines.append(draw(ORDINARY if kind == "o" else ODD) if draw(st.integers(0, 9)) else draw(ODD))
    return "\n".join(lines)


@settings(max_examples=60, deadline=None)
@given(text=obj_lines())
def test_scanned_lines_are_lines_read_one_by_one(text):
    results = []
    for scan in (scanned, lambda *_: None):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(obj, "scanned", scan)
            materials = MeshMaterials(Path("x.obj"))
            try:
                with np.errstate(all="ignore"):
                    parts = list(obj.read_obj(text.encode(), materials, 1000))
                results.append((joined(parts) if parts else None, +materials.notes, materials.origin, ""))
            except obj.DataError as error:
                results.append((None, None, None, str(error)))
    (one, *rest), (other, *same) = results
    assert repr(rest) == repr(same)
    assert (one is None) == (other is None)
    if one is not None:
        for field in fields(one):
            np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name))


def test_ordinary_files_are_scanned_and_numbers_are_rounded_correctly():
    rng = np.random.default_rng(1)
    text = [repr(float(x)) for x in rng.normal(size=600) * 10.0 ** rng.integers(-30, 30, 600)]
    lines = "".join(f"v {' '.join(text[i : i + 6])}\n" for i in range(0, 600, 6))
    found = scanned(lines.encode() + b"usemtl m\nf -1/-1/3 1/2 2//7\n", 10, 20)
    assert found is not None
    assert np.array_equal(found.vertices, np.reshape([float(x) for x in text], (-1, 6)))
    assert found.vertex.tolist() == [110, 1, 2]
    assert found.place.tolist() == [20, 2, 0]
    assert found.others[:, 1].tolist() == [0]
    assert scanned(b"v 1 2 3\nv 1 2 3 0 0 0", 0, 0) is None
