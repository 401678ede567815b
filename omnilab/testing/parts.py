"""What the conformance checks hand to components: images of a small room, and the parts of studies."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import numpy as np

from omnilab import api
from omnilab.api import KINDS, Floats
from omnilab.cameras.base import not_too_steep
from omnilab.errors import DataError, OmnilabError
from omnilab.geometry import planar_poses
from omnilab.image import view_of
from omnilab.runner.registry import Registry, discover
from omnilab.testing.common import expect, smooth_images, smooth_noise
from omnilab.testing.room import SmallRoom

STEPS = np.array([[0, 0, 0], [0.12, 0, 0], [0.2, 0.1, 0.4], [0.15, 0.2, 0.9]])  # x, y, heading: a short path
PLAIN = {  # of each kind the component that asks least of the others, where it is installed
    "descriptor": ("tiny_image", "ring"),
    "sensor": (),
    "distance": ("euclidean", "cosine"),
    "localizer": ("nearest", "smacof"),  # of a dictionary, one that makes a map of its own
    "disturbance": ("gaussian_noise", "blur"),
    "altimeter": ("radon_compression", "floor_and_walls"),
    "odometry": ("simulated", "planar_epipolar"),
    "loop_closure": ("hog_threshold", "none"),
    "backend": ("gtsam_isam2", "gtsam_batch"),
    "view_filter": ("view_ekf", "view_graph"),
}


def path_frames(order: list[int] | None = None) -> api.Frames:
    """Images of the room along a short path, or at some of its poses in another order."""
    steps = _steps(1.0)
    return _all_frames(SmallRoom(), api.PathPoses(steps if order is None else steps[order]))


def frames_of(sensor: Any, count: int = 6) -> api.Frames:
    """The first images of a sensor: a short path from where it may be, or without any pose, as they were recorded."""
    try:
        start = sensor.plan(api.RandomPoses(1, seed=4)).T_world_camera
    except DataError:
        return _all_frames(sensor, api.RecordedPoses(), count)
    return _all_frames(sensor, api.PathPoses(start @ _steps(0.0)))


def _steps(height_m: float) -> Floats:
    return planar_poses(np.column_stack([STEPS[:, :2], np.full(len(STEPS), height_m)]), STEPS[:, 2])


def _all_frames(sensor: Any, layout: api.PoseRequest, most: int = 100) -> api.Frames:
    """The frames of a layout as one batch."""
    plan = sensor.plan(layout)
    batches: list[api.Frames] = list(sensor.frames(plan.at(range(min(most, len(plan))))))
    poses = [batch.T_world_camera for batch in batches if batch.T_world_camera is not None]
    return api.Frames(
        np.concatenate([batch.images for batch in batches]),
        [key for batch in batches for key in batch.keys],
        np.concatenate([batch.stamps_ns for batch in batches]),
        batches[0].camera,
        np.concatenate([batch.plan_index for batch in batches]),
        np.concatenate(poses) if poses else None,
    )


def study_parts(needs: tuple[str, ...] = ()) -> api.Parts:
    """Parts for a study: the room, and in every other slot the plainest of the kind that is installed.

    Of the dictionaries, those alone that the study `needs`, with others than the slot has. AssertionError if one of those that the study `needs` is of a kind that no plugin has.
    """
    registry, sensor = discover(), SmallRoom(64)
    found = {kind.name: _installed(kind.name, registry) for kind in KINDS.values() if kind.part}
    found["sensor"] = {"room": sensor}
    filled: dict[str, Any] = {name: next(iter(found[name].values()), None) for name in found if KINDS[name].slot}
    filled |= {KINDS[name].plural: _others(name, found[name]) for name in found if KINDS[name].plural in needs}
    if descriptor := filled["descriptor"]:
        filled["distance"] = registry.get("distance", descriptor.default_distance).cls()
        filled["map"] = _map(sensor, descriptor)
    compared = filled.get("descriptors", {})
    default = {name: registry.get("distance", one.default_distance).cls() for name, one in compared.items()}
    for need in needs:
        expect(bool(filled.get(need)), f"the study needs {need}, and no plugin has one; install one, or give `parts`")
    return api.Parts(**filled, default_distances=default)


def _others(kind: str, found: Mapping[str, Any]) -> Mapping[str, Any]:
    """Those for a dictionary: not that of the slot where there are others, for studies that compare take both."""
    return dict(list(found.items())[KINDS[kind].slot and len(found) > 1 :])


def signatures_for(distance: Any) -> tuple[api.Signatures, bool]:
    """Places for a distance, and whether a rotation of the camera shifts their last axis.

    Smooth noise; or where the distance refuses that with a DataError, six images as a descriptor describes them that is
    compared with it by default, or any other that is installed.
    """
    registry = discover()
    descriptors = [registry.get("descriptor", name) for name in registry.names("descriptor")]
    own = {c.name for c in registry.components.values() if c.cls is type(distance)}
    descriptors.sort(key=lambda c: c.cls.default_distance not in own)
    noise = api.Signatures(smooth_noise(np.random.default_rng(5), (12, 24, 36)).astype(np.float32))
    for component in [None, *descriptors]:
        with suppress(OmnilabError):  # of a descriptor that needs a file, or a distance that is not for such signatures
            signatures = noise if component is None else _described(component.cls())
            distance.prepare(signatures)
            return signatures, component is None or component.cls.rotation == "equivariant"
    raise DataError("the distance takes no signatures of any installed descriptor; give `signatures`")


def _described(descriptor: Any) -> api.Signatures:
    images = smooth_images(descriptor.view, descriptor.color)
    found: api.Signatures = (descriptor.fit(images) if isinstance(descriptor, api.Trainable) else descriptor).describe(
        images
    )
    return found


def _installed(kind: str, registry: Registry) -> Mapping[str, Any]:
    """The plainest components of a kind, by name."""
    found = [registry.find(kind, name) for name in PLAIN[kind]]
    return {component.name: component.cls() for component in found if component}


def _map(sensor: SmallRoom, descriptor: Any) -> api.Places:
    """Places on a grid of a metre."""
    plan = sensor.plan(api.GridPoses(1.0))
    signatures = [
        descriptor.describe(view_of(batch.images, batch.camera, descriptor.view, descriptor.color)).place
        for batch in sensor.frames(plan)
    ]
    camera = sensor.camera
    low_deg, high_deg = np.rad2deg(not_too_steep(*camera.elevations_rad)).tolist()
    taken_by = api.Provenance(type(camera).__name__, camera.width, camera.height, (low_deg, high_deg), sensor.color)
    return api.Places(api.Signatures(np.concatenate(signatures)), plan.T_world_camera, plan.keys, provenance=taken_by)
