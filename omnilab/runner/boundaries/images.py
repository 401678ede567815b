"""What sensors and all that looks at images must return. A check takes what came back and the arguments, and raises `Wrong`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from omnilab import api
from omnilab.runner.boundaries.values import (
    Wrong,
    array,
    between,
    named,
    number,
    poses,
    rotations,
    sentences,
    typed,
    unit,
    whole,
    within,
)

Memory = dict[Any, Any]  # what is to be remembered of earlier results of a component


class Prepared(NamedTuple):
    """What a distance or localizer prepared, on its way to the method that takes it as `index`."""

    own: Any
    places: int  # that it was prepared from


# ------------------------------------------------------------------------------------------------- images and signatures
def signatures(found: Any, images: Any) -> None:
    """Of descriptors."""
    typed(found, api.Signatures)
    for name in ("place", "heading"):
        part = getattr(found, name)
        if part is None and name == "heading":
            continue
        array(part, f"`{name}`", (len(images), ...), "float32")
        if part.ndim < 2 or 0 in part.shape[1:]:
            raise Wrong(f"`{name}` of shape {part.shape}, which holds no numbers per image")


def same_rows(seen: Memory, found: api.Signatures, images: Any) -> None:
    """The signatures of images of one size have one shape, in all batches."""
    shapes = tuple(None if part is None else part.shape[1:] for part in (found.place, found.heading))
    before = seen.setdefault(images.shape[1:], shapes)
    if shapes != before:
        raise Wrong(
            f"signatures of shape {_shown(shapes)} an image, and {_shown(before)} of images of the same size before"
        )


def _shown(shapes: tuple[Any, ...]) -> str:
    return f"{shapes[0]} and heading {shapes[1]}" if shapes[1] else str(shapes[0])


def trained(found: Any, *_: Any) -> None:
    """What training makes of a descriptor."""
    lacking = [name for name in ("describe", "state") if not callable(getattr(found, name, None))]
    if lacking:
        raise Wrong(f"{named(found)}, which has no {' and no '.join(lacking)}")


def state(found: Any) -> None:
    """Of trained descriptors: what a saved map holds of them."""
    typed(found, Mapping)
    for name, value in found.items():
        kept = np.asarray(value)
        if not isinstance(name, str) or kept.dtype.kind not in "fiubcU":
            raise Wrong(f"{name!r} as {named(value)}, not as an array of numbers")
        if not re.fullmatch(r"\w{1,99}", name):
            raise Wrong(f"the name {name!r:.99}; use letters, digits and _")
        if isinstance(value, np.ma.MaskedArray) or not (np.isfinite(kept).all() if kept.dtype.kind in "fc" else True):
            raise Wrong(f"NaN or infinity in `{name}`, or numbers that are masked")


def images(found: Any, given: Any, *_: Any) -> None:
    """Of disturbances: images like the given ones."""
    array(found, "images", given.shape, "uint8")


def match(found: Any, queries: api.Signatures, index: Any) -> None:
    """Of distances."""
    typed(found, api.Match)
    shape = (len(queries), _places(index))
    array(found.distance, "`distance`", shape)
    if found.rotation_rad is not None:
        array(found.rotation_rad, "`rotation_rad`", found.distance.shape)
    if found.R_place_query is not None:
        rotations(found.R_place_query, "`R_place_query`", found.distance.shape)


def _places(index: Any) -> int | None:
    """How many places an index is of; None if it was prepared elsewhere."""
    return index.places if isinstance(index, Prepared) else None


def estimates(found: Any, queries: api.Signatures, index: Any, *_: Any) -> None:
    """Of localizers; headings may be NaN where they are not known."""
    typed(found, api.Estimates)
    count, places = len(queries), _places(index)
    place = array(found.place, "`place`", (count,), "whole")
    within(place, "`place`", places, "the map's places")
    array(found.distance, "`distance`", (count,))
    array(found.position_m, "`position_m`", (count, 3))
    if found.heading_rad is not None:
        array(found.heading_rad, "`heading_rad`", (count,), nan=True)
    if found.field is not None:
        array(found.field, "`field`", (count, places))


def embedding(found: Any, distance: Any, *_: Any, **__: Any) -> None:
    """Of embedders."""
    typed(found, api.Embedding)
    sets, points, _ = np.shape(distance)
    array(found.position, "`position`", (sets, points, 2))
    array(found.stress, "`stress`", (sets,))
    between(found.stress, "`stress`", 0, np.inf)
    between(array(found.iterations, "`iterations`", (sets,), "whole"), "`iterations`", 0, np.inf)
    if found.steps is not None:
        array(found.steps, "`steps`", (None, sets, points, 2))


def heights(found: Any, references: Any, tests: Any, *_: Any) -> None:  # noqa: ARG001  as the contract has them
    """Of altimeters; NaN where there is no estimate."""
    typed(found, api.Heights)
    count = len(tests)
    for name in ("value", "confidence", "rotation_rad"):
        array(getattr(found, name), f"`{name}`", (count,), "number", nan=True)
    known = np.isfinite(found.value)
    for name in ("confidence", "rotation_rad"):
        if not np.isfinite(getattr(found, name)[known]).all():
            raise Wrong(f"NaN in `{name}` of images whose height it estimates")
    between(found.confidence, "`confidence`", 0, 1)
    unit(found.unit)
    typed(found.curves, Mapping)
    for name, curve in found.curves.items():
        array(curve, f"curve '{name}'", (count, None), "number", nan=True, inf=True)


# ------------------------------------------------------------------------------------------------------------- sensors
def plan(found: Any, *_: Any) -> None:
    """Of sensors."""
    typed(found, api.Plan)
    sentences(found.keys, "`keys`")
    if not all(found.keys):
        raise Wrong("`keys` of which one is empty, and names no image", list(found.keys).index(""))
    sentences(found.omitted, "`omitted`")
    if found.T_world_camera is not None:
        poses(found.T_world_camera, "`T_world_camera`", len(found.keys))
    whole(found.first, "`first`")


def frames(found: Any, planned: api.Plan) -> None:
    """Of sensors: one batch."""
    typed(found, api.Frames)
    sentences(found.keys, "`keys`")
    count = len(found.keys)
    pictures = array(found.images, "`images`", (count, None, None, ...), "uint8")
    if pictures.ndim not in {3, 4} or pictures.shape[3:] not in {(), (3,)} or 0 in pictures.shape[1:]:
        raise Wrong(f"`images` of shape {pictures.shape}, not (N, H, W) or (N, H, W, 3)")
    sentences(found.omitted, "`omitted`")
    array(found.stamps_ns, "`stamps_ns`", (count,), "int64")
    index = array(found.plan_index, "`plan_index`", (count,), "whole")
    within(index, "`plan_index`", len(planned), "the plan's frames")
    _camera(found.camera, pictures.shape[1:3])
    if found.T_world_camera is not None:
        poses(found.T_world_camera, "`T_world_camera`", count)
    if found.depth_m is not None:
        between(array(found.depth_m, "`depth_m`", pictures.shape[:3], nan=True, inf=True), "`depth_m`", 0, np.inf)


def in_order(found: api.Frames, last: int) -> int:
    """Of sensors: no frame comes twice, or before one that the plan has earlier. The last one's number."""
    order = np.concatenate([[last], found.plan_index.astype(np.int64)])
    back = np.flatnonzero(np.diff(order) <= 0)
    if len(back):
        raise Wrong(
            f"`plan_index` {order[back[0] + 1]} after {order[back[0]]}; frames come in the plan's order, each once",
            int(back[0]),
        )
    return int(order[-1])


def _camera(found: Any, shape: tuple[int, ...]) -> None:
    if not isinstance(found, api.Camera):
        raise Wrong(f"`camera` as {named(found)}, not as a Camera")
    if (found.height, found.width) != shape:
        raise Wrong(f"`camera` of {found.width} x {found.height} pixels for images of {shape[1]} x {shape[0]}")
    typed(found.circle, api.Circle)
    for name in ("cx", "cy", "radius", "inner"):
        number(getattr(found.circle, name), f"the circle's `{name}`")
    if not (
        0 <= found.circle.inner < found.circle.radius or found.circle.radius == 0 == found.circle.inner
    ):  # panoramas
        raise Wrong(f"a camera whose circle has radius {found.circle.radius} and inner radius {found.circle.inner}")


def all_frames(delivered: int, left_out: int, planned: api.Plan) -> None:
    """Of sensors: all batches of a plan together."""
    if delivered + left_out < len(planned):
        raise Wrong(
            f"{delivered} of {len(planned)} planned frames, and says of {left_out} why they are missing; every other one"
            " needs a reason in `omitted`"
        )


def mesh(found: Any) -> None:
    """Of sensors: what the viewer shows."""
    if found is None:
        return
    typed(found, api.Mesh)
    array(found.vertices_m, "`vertices_m`", (None, 3))
    array(found.colors, "`colors`", (len(found.vertices_m), 3), "uint8")
    triangles = array(found.triangles, "`triangles`", (None, 3), "whole")
    within(triangles, "`triangles`", len(found.vertices_m), "the vertices")
    if not isinstance(found.one_sided, bool):
        raise Wrong(f"`one_sided` as {named(found.one_sided)}, not as bool")
