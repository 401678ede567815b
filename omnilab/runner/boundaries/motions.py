"""What odometries, loop closures, back ends and view filters must return, as in `images`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from omnilab import api
from omnilab.runner.boundaries.images import Memory
from omnilab.runner.boundaries.values import (
    Wrong,
    array,
    between,
    covariance,
    covariances,
    named,
    number,
    sentences,
    text,
    typed,
    unit,
    unit_vectors,
    whole,
    within,
)


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
            if count and not item.vectors.size:
                raise Wrong(f"`vectors` of shape {item.vectors.shape}, which hold no numbers")
            if item.directions is not None:
                unit_vectors(array(item.directions, "`directions`", (count, 3)), "`directions`")
        if isinstance(item, api.Unusable):
            text(item.reason, "the reason of an Unusable")


def motion(found: Any, *_: Any) -> None:
    """Of odometries; anything goes where the estimate failed, and says so."""
    typed(found, api.Motion)
    text(found.failed, "`failed`", lines=True)
    unit(found.unit)
    whole(found.features, "`features`")
    if found.matches is not None:
        count = len(array(found.matches, "`matches`", (None, 2, 2)))
        if found.agree is not None:
            array(found.agree, "`agree`", (count,), "bool")
    if found.window_rad is not None:
        number(found.window_rad, "`window_rad`")
    array(found.vector, "`vector`", (3,), nan=bool(found.failed))
    if not found.failed:
        covariance(found.covariance, "`covariance`", 3, definite=True)


def closures(found: Any, *_: Any) -> None:
    """Of databases of places."""
    typed(found, api.Closures)
    nodes = found.nodes
    if not (isinstance(nodes, np.ndarray) and nodes.shape == (0,)):  # which NumPy makes of no numbers, as floats
        nodes = array(nodes, "`nodes`", (None,), "whole")
    count = len(nodes)
    if len(np.unique(nodes)) < count:
        raise Wrong(f"`nodes` with a node twice: {nodes.tolist()}")
    array(found.motions, "`motions`", (count, 3))
    covariances(found.covariances, "`covariances`", count, 3, definite=True)
    array(found.distances, "`distances`", (count,))
    whole(found.candidates, "`candidates`")


def earlier_nodes(seen: Memory, found: api.Closures, *_: Any) -> None:
    """Only images that came before can be recognised."""
    within(found.nodes, "`nodes`", seen.get("images", 0), "the images before this one")
    seen["images"] = seen.get("images", 0) + 1


def optimized(found: Any, graph: api.PoseGraph, *_: Any, **__: Any) -> None:
    """Of back ends."""
    typed(found, api.Optimized)
    count, width = graph.poses.shape
    _poses(found.poses, count, width)
    if count and not _is_same_pose(found.poses[0], graph.poses[0]):
        raise Wrong(f"the first pose {found.poses[0]}, which should stay at {graph.poses[0]}", 0)
    for name in ("chi2_before", "chi2"):
        number(getattr(found, name), f"`{name}`")
        between(np.array([getattr(found, name)]), f"`{name}`", 0, np.inf)
    whole(found.iterations, "`iterations`")
    between(array(found.weights, "`weights`", (len(graph.edges),)), "`weights`", 0, 1)
    if found.covariances is not None:
        covariances(found.covariances, "`covariances`", count, graph.information.shape[-1])
    sentences(found.warnings, "`warnings`")
    sentences(found.notes, "`notes`")
    if found.trusted is not None:
        array(found.trusted, "`trusted`", (len(graph.edges),), "bool")
    typed(found.starts, Mapping)
    for name, cost in found.starts.items():
        text(name, "a name in `starts`")
        number(cost, f"`starts` of {name}")


def _poses(found: Any, count: int | None, width: int | None) -> None:
    """Planar poses (N, 3), or spatial ones (N, 7) with unit quaternions."""
    array(found, "poses", (count, width))
    if found.shape[1] == 7:
        unit_vectors(found[:, 3:], "poses", "has no unit quaternion")


def _is_same_pose(one: Any, other: Any) -> bool:
    """Whether poses (k,) are alike but for rounding, and the sign of a quaternion."""
    turned = other * ([1, 1, 1, -1, -1, -1, -1] if len(other) == 7 else 1)
    return any(np.allclose(one, pose, rtol=1e-6, atol=1e-6) for pose in (other, turned))


def graph_poses(found: Any) -> None:
    """All poses of an incremental graph."""
    _poses(found, None, None)


def graph_pose(found: Any, number: int) -> None:  # noqa: ARG001  as the contract has it
    """One pose of an incremental graph."""
    _poses(array(found, "a pose", (None,))[None], 1, None)


def one_more_pose(seen: Memory, *_: Any) -> None:
    """An incremental graph has as many poses as were added, whatever went wrong."""
    seen["poses"] = seen.get("poses", 0) + 1


def width_as_before(seen: Memory, found: Any, *_: Any) -> None:
    """All poses of a graph have as many numbers as the first one."""
    array(found, "a pose", (seen.get("width"),))


def all_added(seen: Memory, found: Any, *_: Any) -> None:
    """All poses of an incremental graph, and no others."""
    array(found, "poses", (None if "width" not in seen else 1 + seen.get("poses", 0), seen.get("width")))


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


def next_view(seen: Memory, found: int, *_: Any) -> None:
    """Views are numbered as they come, from 0."""
    if found != seen.setdefault("views", 0):
        raise Wrong(f"{found} as the view's number, not {seen['views']}; views are numbered as they come")
    seen["views"] += 1


def robot_pose(found: Any) -> None:
    """Of maps of views: the robot's pose and its covariance."""
    if not isinstance(found, tuple) or len(found) != 2:
        raise Wrong(f"{named(found)}, not a pose and its covariance")
    array(found[0], "a pose", (3,))
    covariance(found[1], "a covariance", 3)


def planar_poses(found: Any) -> None:
    """Of maps of views."""
    array(found, "poses", (None, 3))


def all_views(seen: Memory, found: Any) -> None:
    """Of maps of views: one for each view."""
    array(found, "what it knows of views", (seen.get("views", 0), ...))


def one_more_step(seen: Memory, *_: Any) -> None:
    """Of maps of views: the trajectory grows by a pose with each prediction."""
    seen["steps"] = seen.get("steps", 0) + 1


def all_steps(seen: Memory, found: Any) -> None:
    """Of maps of views: the first pose, and one after each prediction."""
    array(found, "poses", (seen.get("steps", 0) + 1, 3))


def view_covariances(found: Any) -> None:
    """Of maps of views."""
    covariances(found, "covariances", len(found) if isinstance(found, np.ndarray) and found.ndim else 0, 3)
