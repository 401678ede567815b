"""What studies share: describing frames, showing a query, statistics as metrics."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from omnilab.api import (
    Descriptor,
    Disturbance,
    Floats,
    Frames,
    Image,
    Ints,
    Metric,
    Parts,
    Places,
    Plan,
    Pose,
    Recorder,
    Signature,
    Signatures,
    Tick,
    Trainable,
    TrainedDescriptor,
)
from omnilab.errors import DataError, PluginError
from omnilab.image import panorama, view_of


def evenly(count: int, most: int) -> Ints:
    """At most so many of the numbers from 0 to below count, the first and the last among them, evenly chosen."""
    return np.linspace(0, count - 1, min(most, count)).astype(int)


def deliver(parts: Parts, plan: Plan, record: Recorder, stage: str) -> Iterator[Frames]:
    """The frames of a plan, with progress shown and the sensor's time measured."""
    frames = parts.sensor.frames(plan)
    counted = record.track(
        _timed(frames, record, f"{stage}: images"), stage, len(plan), lambda f: len(f) + len(f.omitted)
    )
    yield from counted


def deliver_queries(parts: Parts, plan: Plan, record: Recorder, seed: int) -> Iterator[Frames]:
    """The same for queries, which are disturbed."""
    for frames in deliver(parts, plan, record, "queries"):
        if not parts.disturbances:
            yield frames
            continue
        with record.timed("disturb", len(frames)):
            spoilt = disturbed(frames, parts.disturbances, seed)
        yield spoilt


def disturbed(frames: Frames, disturbances: Mapping[str, Disturbance], seed: int) -> Frames:
    """Frames whose images went through every disturbance, in order; their keys stay those of the clear images.

    An image has a generator of its own for each disturbance, from the seed, the disturbance's name and the image's key:
    it comes out the same in any batch, whatever the other disturbances are.
    """
    images = frames.images
    for name, disturbance in disturbances.items():
        rngs = [_generator(f"{seed} {name} {key}") for key in frames.keys]
        images = disturbance.apply(images, frames.camera, rngs)
    return replace(frames, images=images)


def _generator(words: str) -> np.random.Generator:
    return np.random.default_rng(int.from_bytes(hashlib.blake2b(words.encode(), digest_size=16).digest()))


def _timed(frames: Iterator[Frames], record: Recorder, stage: str) -> Iterator[Frames]:
    while True:
        with record.timed(stage, 0):
            batch = next(frames, None)
        if batch is None:
            return
        yield batch


def describe(descriptor: Descriptor, frames: Frames, record: Recorder) -> Signatures:
    """Signatures of frames, each prepared as the descriptor wants to see it."""
    with record.timed("describe", len(frames)):
        described = descriptor.describe(view_of(frames.images, frames.camera, descriptor.view, descriptor.color))
    place: Any = getattr(described, "place", described)  # a plugin's mistake may be of any type
    if place is described or len(place) != len(frames) or place.dtype != np.float32:
        found = f"{type(described).__name__} of {getattr(place, 'dtype', '?')} {getattr(place, 'shape', '?')}"
        raise PluginError(
            f"{type(descriptor).__name__} describes {len(frames)} images as {found}; return Signatures whose place is float32"
            " (N, ...): omnilab.testing.check_descriptor finds such things"
        )
    return described


def fitted(parts: Parts, plan: Plan, record: Recorder) -> Parts:
    """The parts with a descriptor that has seen the map, where it must: one that learns is fitted on the plan's frames."""
    learner = parts.descriptor
    if not isinstance(learner, Trainable):
        return parts
    frames = deliver(parts, plan, record, "fit")
    views = np.concatenate([view_of(f.images, f.camera, learner.view, learner.color) for f in frames])
    with record.timed("fit", len(views)):
        descriptor = learner.fit(views)
    return replace(parts, descriptor=descriptor)


def describe_places(parts: Parts, plan: Plan, record: Recorder, stage: str = "places") -> tuple[Places, list[str]]:
    """The map: every frame of the plan described; and the frames that could not be delivered, with reasons."""
    signatures: Signatures | None = None
    keys: list[str] = []
    omitted = list(plan.omitted)
    poses: list[Floats] = []
    count = 0
    for frames in deliver(parts, plan, record, stage):
        described = describe(parts.descriptor, frames, record)
        if signatures is None:
            signatures = _empty(described, len(plan))
        signatures.place[count : count + len(frames)] = described.place
        if signatures.heading is not None and described.heading is not None:
            signatures.heading[count : count + len(frames)] = described.heading
        count += len(frames)
        keys += [plan.keys[i] for i in frames.plan_index]
        omitted += frames.omitted
        if frames.T_world_camera is not None:
            poses.append(frames.T_world_camera)
    if signatures is None:
        raise DataError("the sensor delivered no places for the study's layout; give a larger area or a smaller step")
    learnt = parts.descriptor.state() if isinstance(parts.descriptor, TrainedDescriptor) else {}
    return Places(signatures[slice(count)], np.concatenate(poses) if poses else None, keys, learnt), omitted


def _empty(like: Signatures, count: int) -> Signatures:
    """Room for all places at once, so that a large map is never held twice."""
    heading = None if like.heading is None else np.empty((count, *like.heading.shape[1:]), like.heading.dtype)
    return Signatures(np.empty((count, *like.place.shape[1:]), like.place.dtype), heading)


def show_frame(record: Recorder, frames: Frames, i: int, signature: Floats, tick: Tick) -> None:
    """One frame of a batch into the logs: picture, panorama, signature (...), pose."""
    show_picture(record, frames, i, tick)
    show_signature(record, signature, tick)


def show_picture(record: Recorder, frames: Frames, i: int, tick: Tick) -> None:
    """One frame of a batch into the logs: picture, panorama, pose."""
    image = frames.images[i]
    record.log("query/image", Image(image), tick)
    unwrapped = panorama(image[None], frames.camera)[0]
    record.log("query/panorama", Image(unwrapped[:, ::-1]), tick)  # as a person sees it: clockwise to the right
    if frames.T_world_camera is not None:
        record.log("camera", Pose(frames.T_world_camera[i]), tick)


def show_signature(record: Recorder, signature: Floats, tick: Tick) -> None:
    """A signature (...) into the logs, as a matrix."""
    matrix = signature if signature.ndim == 2 else signature.reshape(1, -1)
    record.log("query/signature", Signature(matrix), tick)


def statistics(name: str, values: Floats, unit: str) -> list[Metric]:
    """Median, mean and 95 % quantile."""
    return [
        Metric(f"{name}_median", float(np.median(values)), unit),
        Metric(f"{name}_mean", float(np.mean(values)), unit),
        Metric(f"{name}_p95", float(np.quantile(values, 0.95)), unit),
    ]


def markdown_table(metrics: list[Metric], title: str) -> str:
    """Metrics as a Markdown document, for the viewer."""
    rows = [f"| {m.name.replace('_', ' ')} | {m.value:.4g} {'' if m.unit == '1' else m.unit} |" for m in metrics]
    return "\n".join([f"## {title}", "", "| | |", "|---|---|", *rows])
