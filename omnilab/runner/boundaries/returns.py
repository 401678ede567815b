"""What each method of each kind must return. A check takes what came back and the arguments, and raises `Wrong`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from omnilab import api
from omnilab.errors import PluginError
from omnilab.runner.boundaries.values import (
    Wrong,
    array,
    covariances,
    named,
    number,
    poses,
    sentences,
    typed,
    whole,
    within,
)

VIEWS, ROTATIONS = ("mirror", "panorama"), ("equivariant", "invariant", "none")


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
        if not isinstance(part, np.ndarray):
            raise Wrong(f"`{name}` as {named(part)}, not as an array")
        array(part, f"`{name}`", (len(images), ...))
        if part.dtype != np.float32:
            raise Wrong(f"`{name}` of type {part.dtype}, not float32")
        if part.ndim < 2 or 0 in part.shape[1:]:
            raise Wrong(f"`{name}` of shape {part.shape}, which holds no numbers per image")


def row_shapes(found: api.Signatures) -> tuple[tuple[int, ...] | None, ...]:
    """The shapes of one image's signature: those of all batches are alike."""
    return tuple(None if part is None else part.shape[1:] for part in (found.place, found.heading))


def trained(found: Any, *_: Any) -> None:
    """What training makes of a descriptor."""
    lacking = [name for name in ("describe", "state") if not callable(getattr(found, name, None))]
    if lacking:
        raise Wrong(f"{named(found)}, which has no {' and no '.join(lacking)}")


def state(found: Any) -> None:
    """Of trained descriptors."""
    typed(found, Mapping)
    for name, value in found.items():
        kept = np.asarray(value)
        if not isinstance(name, str) or kept.dtype.kind not in "fiubcU":
            raise Wrong(f"{name!r} as {named(value)}, not as an array of numbers")
        if kept.dtype.kind in "fc":
            array(np.abs(kept), f"`{name}`", kept.shape)  # of complex numbers, their size


def images(found: Any, given: Any, *_: Any) -> None:
    """Of disturbances: images like the given ones."""
    array(found, "images", given.shape, "uint8")


def match(found: Any, queries: api.Signatures, index: Any) -> None:
    """Of distances."""
    typed(found, api.Match)
    shape = (len(queries), index.places if isinstance(index, Prepared) else None)
    array(found.distance, "`distance`", shape)
    if found.rotation_rad is not None:
        array(found.rotation_rad, "`rotation_rad`", found.distance.shape)


def estimates(found: Any, queries: api.Signatures, index: Any, *_: Any) -> None:
    """Of localizers; headings may be NaN where they are not known."""
    typed(found, api.Estimates)
    count, places = len(queries), index.places if isinstance(index, Prepared) else None
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
    array(found.iterations, "`iterations`", (sets,), "whole")
    if found.steps is not None:
        array(found.steps, "`steps`", (None, sets, points, 2))


def heights(found: Any, references: Any, tests: Any, *_: Any) -> None:  # noqa: ARG001  as the contract has them
    """Of altimeters; NaN where there is no estimate."""
    typed(found, api.Heights)
    count = len(tests)
    for name in ("value", "confidence", "rotation_rad"):
        array(getattr(found, name), f"`{name}`", (count,), "number", nan=True)
    known = np.isfinite(np.asarray(found.value, float))
    if not np.isfinite(np.asarray(found.rotation_rad, float)[known]).all():
        raise Wrong("NaN in `rotation_rad` of images whose height it estimates")
    if not (
        (np.asarray(found.confidence, float)[known] >= 0) & (np.asarray(found.confidence, float)[known] <= 1)
    ).all():
        raise Wrong("`confidence` outside of [0, 1]")
    typed(found.unit, str)
    typed(found.curves, Mapping)
    for name, curve in found.curves.items():
        array(curve, f"curve '{name}'", (count, None), "number", nan=True, inf=True)


# ------------------------------------------------------------------------------------------------------------- sensors
def plan(found: Any, *_: Any) -> None:
    """Of sensors."""
    typed(found, api.Plan)
    sentences(found.keys, "`keys`")
    sentences(found.omitted, "`omitted`")
    if found.T_world_camera is not None:
        poses(found.T_world_camera, "`T_world_camera`", len(found.keys))


def frames(found: Any, planned: api.Plan) -> None:
    """Of sensors: one batch."""
    typed(found, api.Frames)
    count = len(found.keys)
    pictures = array(found.images, "`images`", (count, None, None, ...), "uint8")
    if pictures.ndim not in {3, 4} or pictures.shape[3:] not in {(), (3,)} or 0 in pictures.shape[1:]:
        raise Wrong(f"`images` of shape {pictures.shape}, not (N, H, W) or (N, H, W, 3)")
    sentences(found.keys, "`keys`")
    sentences(found.omitted, "`omitted`")
    array(found.stamps_ns, "`stamps_ns`", (count,), "whole")
    within(
        array(found.plan_index, "`plan_index`", (count,), "whole"), "`plan_index`", len(planned), "the plan's frames"
    )
    if not isinstance(found.camera, api.Camera):
        raise Wrong(f"`camera` as {named(found.camera)}, not as a Camera")
    if found.T_world_camera is not None:
        poses(found.T_world_camera, "`T_world_camera`", count)
    if found.depth_m is not None:
        array(found.depth_m, "`depth_m`", pictures.shape[:3], nan=True, inf=True)


def all_frames(delivered: int, left_out: int, planned: api.Plan) -> None:
    """Of sensors: all batches of a plan together."""
    if delivered + left_out < len(planned):
        raise Wrong(
            f"{delivered} of {len(planned)} planned frames, and says of {left_out} why they are missing; every other one"
            " needs a reason in `omitted`"
        )
    if delivered > len(planned):
        raise Wrong(f"{delivered} frames for a plan of {len(planned)}")


def mesh(found: Any) -> None:
    """Of sensors: what the viewer shows."""
    if found is None:
        return
    typed(found, api.Mesh)
    array(found.vertices_m, "`vertices_m`", (None, 3))
    triangles = array(found.triangles, "`triangles`", (None, 3), "whole")
    within(triangles, "`triangles`", len(found.vertices_m), "the vertices")


# ---------------------------------------------------------------------------------------------------- motions and graphs
def features(found: Any, given: api.Frames) -> None:
    """Of odometries: what `estimate` needs is their own business, but for its number and what they share."""
    if not isinstance(found, Sequence) and not isinstance(found, np.ndarray):
        raise Wrong(f"{named(found)}, not a sequence with an item per image")
    if len(found) != len(given):
        raise Wrong(f"{len(found)} items for {len(given)} images")
    for item in found:
        if isinstance(item, api.ImageFeatures):
            count = len(array(item.azimuth_level, "`azimuth_level`", (None, 2)))
            array(item.vectors, "`vectors`", (count, None), "number")
            if item.directions is not None:
                array(item.directions, "`directions`", (count, 3))


def motion(found: Any, *_: Any) -> None:
    """Of odometries; anything goes where the estimate failed, and says so."""
    typed(found, api.Motion)
    typed(found.failed, str)
    typed(found.unit, str)
    if not found.failed:
        array(found.vector, "`vector`", (3,))
        covariances(np.asarray(found.covariance)[None], "`covariance`", 1, 3, definite=True)


def closures(found: Any, *_: Any) -> None:
    """Of databases of places."""
    typed(found, api.Closures)
    nodes = array(
        np.asarray(found.nodes, int) if np.size(found.nodes) == 0 else found.nodes, "`nodes`", (None,), "whole"
    )
    count = len(nodes)
    array(found.motions, "`motions`", (count, 3))
    covariances(np.asarray(found.covariances), "`covariances`", count, 3, definite=True)
    array(found.distances, "`distances`", (count,))
    whole(found.candidates, "`candidates`")


def closed_nodes(found: api.Closures, earlier: int) -> None:
    """Of databases of places: only images that came before can be recognised."""
    within(np.asarray(found.nodes), "`nodes`", earlier, "the images before this one")


def optimized(found: Any, graph: api.PoseGraph, *_: Any, **__: Any) -> None:
    """Of back ends."""
    typed(found, api.Optimized)
    count, width = graph.poses.shape
    _graph_poses(found.poses, count, width)
    for name in ("chi2_before", "chi2"):
        number(getattr(found, name), f"`{name}`")
    whole(found.iterations, "`iterations`")
    weights = array(found.weights, "`weights`", (len(graph.edges),), "number")
    if ((weights < 0) | (weights > 1)).any():
        raise Wrong("`weights` outside of [0, 1]")
    if found.covariances is not None:
        covariances(found.covariances, "`covariances`", count, graph.information.shape[-1])
    sentences(found.warnings, "`warnings`")
    sentences(found.notes, "`notes`")
    if found.trusted is not None:
        array(found.trusted, "`trusted`", (len(graph.edges),), "bool")
    for name, cost in found.starts.items():
        number(cost, f"`starts` of {name}")


def _graph_poses(found: Any, count: int | None, width: int | None) -> None:
    """Planar poses (N, 3), or spatial ones (N, 7) with unit quaternions."""
    array(found, "poses", (count, width))
    if found.shape[1] == 7:
        off = np.abs(np.linalg.norm(found[:, 3:], axis=1) - 1) > 1e-3
        if off.any():
            first = int(np.flatnonzero(off)[0])
            raise Wrong(f"poses of which number {first} has no unit quaternion: {found[first, 3:]}", first)


def graph_poses(found: Any) -> None:
    """All poses of an incremental graph."""
    _graph_poses(found, None, None)


def graph_pose(found: Any, number: int) -> None:  # noqa: ARG001  as the contract has it
    """One pose of an incremental graph."""
    array(found, "a pose", (None,))


def warnings(found: Any, *_: Any) -> None:
    """What went wrong, in sentences."""
    sentences(found, "warnings")


def observed(found: Any, views: Any, *_: Any) -> None:
    """Of maps of views: which views are believed."""
    if not isinstance(found, tuple) or len(found) != 2:
        raise Wrong(f"{named(found)}, not which views it believes and warnings")
    array(found[0], "which views it believes", (len(views),), "bool")
    sentences(found[1], "warnings")


def view_number(found: Any, *_: Any) -> None:
    """Of maps of views: the number of a view."""
    whole(found, "the view's number")


def robot_pose(found: Any) -> None:
    """Of maps of views: the robot's pose and its covariance."""
    if not isinstance(found, tuple) or len(found) != 2:
        raise Wrong(f"{named(found)}, not a pose and its covariance")
    array(found[0], "a pose", (3,))
    covariances(np.asarray(found[1])[None], "a covariance", 1, 3)


def planar_poses(found: Any) -> None:
    """Of maps of views."""
    array(found, "poses", (None, 3))


def view_covariances(found: Any) -> None:
    """Of maps of views."""
    covariances(found, "covariances", len(found) if isinstance(found, np.ndarray) and found.ndim else 0, 3)


class Check(NamedTuple):
    """The check of a method, and what one of its results is about."""

    check: Callable[..., None]
    item: str = ""


CHECKS: dict[str, dict[str, Check]] = {
    "sensor": {"plan": Check(plan, "frame"), "frames": Check(frames, "frame"), "scene": Check(mesh)},
    "disturbance": {"apply": Check(images, "image")},
    "descriptor": {
        "describe": Check(signatures, "image"), "fit": Check(trained), "restore": Check(trained), "state": Check(state)
    },
    "distance": {"match": Check(match, "query")},
    "localizer": {
        "locate": Check(estimates, "query"), "track": Check(estimates, "query"), "embed": Check(embedding, "set")
    },
    "altimeter": {"relative": Check(heights, "image")},
    "odometry": {"extract": Check(features, "image"), "estimate": Check(motion)},
    "loop_closure": {},
    "place_database": {"query": Check(closures, "closure")},
    "backend": {"optimize": Check(optimized, "node")},
    "incremental_graph": {"add": Check(warnings), "pose": Check(graph_pose), "poses": Check(graph_poses, "node")},
    "view_filter": {},
    "view_map": {
        "predict": Check(warnings), "observe": Check(observed, "view"), "add_view": Check(view_number),
        "know_view": Check(view_number), "pose": Check(robot_pose), "views": Check(planar_poses, "view"),
        "view_covariances": Check(view_covariances, "view"), "finish": Check(planar_poses, "pose"),
    },
}  # fmt: skip
BEGUN = {"loop_closure": "place_database", "backend": "incremental_graph", "view_filter": "view_map"}  # by `begin`
PROTOCOLS = {
    "place_database": api.PlaceDatabase, "incremental_graph": api.IncrementalGraph, "view_map": api.ViewMap
}  # fmt: skip


def check_declared(kind: str, component: Any, title: str) -> None:
    """PluginError unless a component declares itself in the contract's words."""
    if kind != "descriptor":
        return
    for name, known in (("view", VIEWS), ("rotation", ROTATIONS)):
        if getattr(component, name) not in known:
            raise PluginError(
                f"{title} declares {name}={getattr(component, name)!r}, which is none of {', '.join(known)}"
            )
    if not isinstance(component.color, bool):
        raise PluginError(f"{title} declares color={component.color!r}, which is neither True nor False")


def check_report(found: Any, title: str) -> None:
    """PluginError unless a study returns a report that can be written."""
    try:
        typed(found, api.Report)
        for metric in found.metrics:
            typed(metric, api.Metric)
            if isinstance(metric.value, bool) or not np.isscalar(metric.value) or isinstance(metric.value, str | bytes):
                raise Wrong(f"metric '{metric.name}' as {named(metric.value)}, not as a number")
        names = [metric.name for metric in found.metrics]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise Wrong(f"metric '{twice[0]}' twice")
        for name, table in found.tables.items():
            lengths = {column: len(values) for column, values in table.items()}
            if len(set(lengths.values())) > 1:
                raise Wrong(f"table '{name}' with columns of different lengths: {lengths}")
    except Wrong as wrong:
        raise PluginError(f"{title}: run returns {wrong}; see Report in omnilab.api") from None
