"""Frames of a plan: delivered by the sensor, and disturbed."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from omnilab.api import Disturbance, Frames, Parts, Plan, Recorder


def at_once(parts: Parts) -> int:
    """How many frames the sensor delivers at a time, as far as it says: results of these are computed together."""
    return int(getattr(parts.sensor, "batch", 1))


def deliver(
    parts: Parts, plan: Plan, record: Recorder, stage: str, share: tuple[int, int] | None = None
) -> Iterator[Frames]:
    """The frames of a plan, or those of a share, first to last; with progress shown and the sensor's time measured."""
    first, last = share or (0, len(plan))
    whole = (first, last) == (0, len(plan))
    frames = parts.sensor.frames(plan if whole else plan.part(first, last))
    counted = record.track(
        _timed(frames, record, f"{stage}: images"), stage, last - first, lambda f: len(f) + len(f.omitted)
    )
    if whole:
        yield from counted
    else:
        yield from (replace(batch, plan_index=first + batch.plan_index) for batch in counted)


def deliver_queries(
    parts: Parts, plan: Plan, record: Recorder, seed: int, share: tuple[int, int] | None = None
) -> Iterator[Frames]:
    """The frames of a plan of queries, or of a share of it, disturbed by the run's disturbances."""
    for frames in deliver(parts, plan, record, "queries", share):
        if not parts.disturbances:
            yield frames
            continue
        with record.timed("disturb", len(frames)):
            noisy = disturbed(frames, parts.disturbances, seed)
        yield noisy


def disturbed(frames: Frames, disturbances: Mapping[str, Disturbance], seed: int) -> Frames:
    """Frames with every disturbance applied in order; their keys stay those of the clear images.

    An image has a generator of its own for each disturbance, from the seed, the disturbance's name and the image's key:
    its result does not depend on the batch, nor on the other disturbances.
    """
    images = frames.images
    for name, disturbance in disturbances.items():
        rngs = [_generator(f"{seed} {name} {key}") for key in frames.keys]
        images = disturbance.apply(images, frames.camera, rngs)
    return replace(frames, images=images)


def _generator(name: str) -> np.random.Generator:
    return np.random.default_rng(int.from_bytes(hashlib.blake2b(name.encode(), digest_size=16).digest()))


def _timed(frames: Iterator[Frames], record: Recorder, stage: str) -> Iterator[Frames]:
    while True:
        with record.timed(stage, 0):
            batch = next(frames, None)
        if batch is None:
            return
        yield batch
