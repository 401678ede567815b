"""Frames to signatures: descriptors trained where they must be, places described into a map."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import asdict, replace

import numpy as np

from omnilab.api import (
    Array,
    Batch,
    Bytes,
    Descriptor,
    Floats,
    Frames,
    Parts,
    Places,
    Plan,
    Provenance,
    Recorder,
    Sensor,
    Signatures,
    Trainable,
    TrainedDescriptor,
)
from omnilab.cameras.base import not_too_steep
from omnilab.errors import DataError, PluginError
from omnilab.image import view_of
from omnilab.limits import check_work
from omnilab_studies.common.frames import at_once, deliver


def describe(descriptor: Descriptor, frames: Frames, record: Recorder) -> Signatures:
    """Signatures of frames, from the view that the descriptor declares."""
    with record.timed("describe", len(frames)):
        views = view_of(frames.images, frames.camera, descriptor.view, descriptor.color)
        try:
            return descriptor.describe(views)
        except PluginError as error:  # it knows an image by its number in the batch, a user by its key
            if error.item is None:
                raise
            raise PluginError(f"{error} (image number {error.item} is {frames.keys[error.item]})") from None


def check_signatures(like: Signatures, count: int, what: str) -> None:
    """ConfigError if so many signatures like these do not fit into memory."""
    each = like.nbytes / max(1, len(like))
    check_work(
        f"the signatures of {count} {what}, {each:.3g} bytes each,",
        f"give fewer {what} (a larger step, a smaller area), or a smaller descriptor",
        memory=count * each,
    )


def check_views(like: Bytes, count: int) -> None:
    """ConfigError if so many views like these (N, H, W[, 3]) do not fit into memory."""
    memory = count * like.nbytes / max(1, len(like))
    check_work(
        f"{count} images of {like.shape[2]} x {like.shape[1]} pixels at once",
        "give fewer places (a larger step, a smaller area), or smaller images",
        memory=memory,
    )


def fitted(parts: Parts, plan: Plan, record: Recorder, is_kept: bool = False) -> Parts:
    """The parts with a descriptor that can describe: a trainable one is trained on the plan's frames.

    `is_kept`: what it learns is a result, too, so a run that merges shards, and describes nothing, has it learn as well.
    """
    trainable = parts.descriptor
    if not isinstance(trainable, Trainable) or (parts.shards.merges and not is_kept):
        return parts
    frames = deliver(parts, plan, record, "fit")
    found: list[Bytes] = []
    for batch in frames:
        found.append(view_of(batch.images, batch.camera, trainable.view, trainable.color))
        if len(found) == 1:
            check_views(found[0], len(plan))
    views = np.concatenate(found)
    with record.timed("fit", len(views)):
        descriptor = trainable.fit(views)
    return replace(parts, descriptor=descriptor)


def describe_places(parts: Parts, plan: Plan, record: Recorder, stage: str = "places") -> tuple[Places, list[str]]:
    """The map: every frame of the plan described; and the frames that were not delivered, with reasons.

    DataError if there is none.
    """

    def compute(first: int, last: int) -> Iterator[Batch]:
        return _described(parts, plan, (first, last), record, stage)

    signatures: Signatures | None = None
    provenance: Provenance | None = None
    keys: list[str] = []
    omitted = list(plan.omitted)
    poses: list[Floats] = []
    count = 0
    for batch in parts.shards.work(stage, len(plan), compute, at_once(parts)):
        described = Signatures(batch["place"], batch.get("heading"))
        if signatures is None:
            signatures, provenance = _empty(described, len(plan)), _read_provenance(str(batch["provenance"][0]))
        signatures.place[count : count + len(described)] = described.place
        if signatures.heading is not None and described.heading is not None:
            signatures.heading[count : count + len(described)] = described.heading
        count += len(described)
        keys += [plan.keys[i] for i in batch["plan_index"]]
        omitted += batch["omitted"].tolist()
        if "T_world_camera" in batch:
            poses.append(batch["T_world_camera"])
    if signatures is None:
        raise DataError("the sensor delivered no places for the study's layout; give a larger area or a smaller step")
    state = parts.descriptor.state() if isinstance(parts.descriptor, TrainedDescriptor) else {}
    return Places(signatures[slice(count)], np.concatenate(poses) if poses else None, keys, state, provenance), omitted


def _described(
    parts: Parts, plan: Plan, share: tuple[int, int], record: Recorder, stage: str
) -> Iterator[dict[str, Array]]:
    """Some frames of a plan described, batch by batch; the first says by what they were taken."""
    provenance: Provenance | None = None
    for frames in deliver(parts, plan, record, stage, share):
        described = describe(parts.descriptor, frames, record)
        batch = {
            "place": described.place,
            "plan_index": frames.plan_index,
            "omitted": np.array(frames.omitted, np.str_),
        }
        if described.heading is not None:
            batch["heading"] = described.heading
        if frames.T_world_camera is not None:
            batch["T_world_camera"] = frames.T_world_camera
        if provenance is None:
            provenance = provenance_of(frames, parts.sensor)
            batch["provenance"] = np.array([json.dumps(asdict(provenance))])
        yield batch


def _read_provenance(text: str) -> Provenance:
    content = json.loads(text)
    degrees = content.pop("elevations_deg")
    return Provenance(**content, elevations_deg=degrees and (degrees[0], degrees[1]))


def provenance_of(frames: Frames, sensor: Sensor) -> Provenance:
    """By what frames were taken, and of what; the elevations are those of their panoramas."""
    camera = frames.camera
    elevations = getattr(camera, "elevations_rad", None)
    lowest, highest = not_too_steep(*elevations) if elevations else (0.0, 0.0)
    world, digest = getattr(sensor, "imaged_world", (None, None))
    return Provenance(
        camera=f"{type(camera).__name__}{' with the sky inside' if getattr(camera, 'sky_inside', False) else ''}",
        width=int(camera.width),
        height=int(camera.height),
        elevations_deg=(math.degrees(lowest), math.degrees(highest)) if elevations else None,
        color=frames.images.ndim == 4,
        world=world,
        world_digest=digest,
    )


def _empty(like: Signatures, count: int) -> Signatures:
    """Memory for all places at once, so that a large map is never there twice."""
    check_signatures(like, count, "places")
    heading = None if like.heading is None else np.empty((count, *like.heading.shape[1:]), like.heading.dtype)
    return Signatures(np.empty((count, *like.place.shape[1:]), like.place.dtype), heading)
