"""The checks of what components return, by kind and method; and what components declare of themselves."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from omnilab import api
from omnilab.errors import PluginError
from omnilab.runner.boundaries import images, motions

VIEWS, ROTATIONS = ("mirror", "panorama", "sphere"), ("equivariant", "invariant", "none")


class Check(NamedTuple):
    """The check of a method, what one of its results is about, and the check against earlier results of the component."""

    check: Callable[..., None]
    item: str = ""
    beside: Callable[..., None] | None = None  # called with the component's Memory, the result, the arguments


CHECKS: dict[str, dict[str, Check]] = {
    "sensor": {
        "plan": Check(images.plan, "frame"), "frames": Check(images.frames, "frame"), "scene": Check(images.mesh)
    },
    "disturbance": {"apply": Check(images.images, "image")},
    "descriptor": {
        "describe": Check(images.signatures, "image", images.same_rows), "fit": Check(images.trained),
        "restore": Check(images.trained), "state": Check(images.state),
    },
    "distance": {"match": Check(images.match, "query")},
    "localizer": {
        "locate": Check(images.estimates, "query"), "track": Check(images.estimates, "query"),
        "embed": Check(images.embedding, "set"),
    },
    "altimeter": {"relative": Check(images.heights, "image")},
    "odometry": {"extract": Check(motions.features, "image"), "estimate": Check(motions.motion)},
    "loop_closure": {},
    "place_database": {"query": Check(motions.closures, "closure", motions.earlier_nodes)},
    "backend": {"optimize": Check(motions.optimized, "node")},
    "incremental_graph": {
        "add": Check(motions.warnings, "", motions.one_more_pose),
        "pose": Check(motions.graph_pose, "", motions.width_as_before),
        "poses": Check(motions.graph_poses, "node", motions.all_added),
    },
    "view_filter": {},
    "view_map": {
        "predict": Check(motions.warnings, "", motions.one_more_step), "observe": Check(motions.observed, "view"),
        "add_view": Check(motions.view_number, "", motions.next_view),
        "know_view": Check(motions.view_number, "", motions.next_view),
        "pose": Check(motions.robot_pose), "views": Check(motions.planar_poses, "view", motions.all_views),
        "view_covariances": Check(motions.view_covariances, "view", motions.all_views),
        "finish": Check(motions.planar_poses, "pose", motions.all_steps),
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
