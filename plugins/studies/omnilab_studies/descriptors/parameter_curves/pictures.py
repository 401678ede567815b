"""Images of a plan in the views that descriptors want, and their signatures, with the time of both, batch by batch."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from functools import partial
from typing import NamedTuple

import numpy as np

from omnilab.api import Bytes, Descriptor, Floats, Frames, Ints, Plan, Recorder, Signatures, Tick, Trainable
from omnilab.errors import DataError
from omnilab.image import view_of
from omnilab_studies.common.describing import check_signatures, check_views
from omnilab_studies.common.logs import show_picture
from omnilab_studies.common.methods import joined_signatures
from omnilab_studies.common.timing import timed, timed_twice

BATCH = 16  # images that a sample of time is averaged over
WARM_UP = 2  # images described before time is taken: the first call may compile


class Described(NamedTuple):
    """Signatures of pictures by a descriptor, and milliseconds an image: one number of training, a sample a batch of the others."""

    descriptor: Descriptor  # trained, where it is to be
    signatures: Signatures
    fit_ms: float
    fit_cpu_ms: float  # of the processor, all threads together
    view_ms: Floats
    describe_ms: Floats
    describe_cpu_ms: Floats


class Pictures:
    """The frames of a plan, in memory, with their views and signatures, each made once."""

    def __init__(self, delivered: Iterable[Frames], plan: Plan, record: Recorder) -> None:
        self.omitted = list(plan.omitted)
        kept: list[Frames] = []
        for frames in delivered:
            self.omitted += frames.omitted
            if len(frames):
                if not kept:
                    check_views(frames.images, len(plan))
                    show_picture(record, frames, 0, Tick(int(frames.plan_index[0]), int(frames.stamps_ns[0])))
                kept.append(frames)
        if not kept:
            raise DataError("the sensor delivered no images for the study's layout; ask for others")
        self.frames = _joined(kept)
        self.batches = [slice(i, min(i + BATCH, len(self))) for i in range(0, len(self), BATCH)]
        self.lines: Ints = np.empty((0, 0), int)  # (A, n + 1) of the images, where they were taken along lines
        self._views: dict[tuple[str, bool], tuple[Bytes, Floats]] = {}
        self._described: dict[int, tuple[object, Described]] = {}  # by the identity of what stands beside it

    def __len__(self) -> int:
        return len(self.frames)

    def part(self, which: slice) -> Frames:
        """Some of the frames."""
        all_of = self.frames
        poses = None if all_of.T_world_camera is None else all_of.T_world_camera[which]
        return Frames(
            all_of.images[which], all_of.keys[which], all_of.stamps_ns[which], all_of.camera, all_of.plan_index[which], poses
        )  # fmt: skip

    def described_by(self, descriptor: Descriptor | Trainable, repeats: int) -> Described:
        """Their signatures, made so often; by a trainable descriptor that is trained on them first."""
        if id(descriptor) not in self._described:
            self._described[id(descriptor)] = (descriptor, self._describe(descriptor, repeats))
        return self._described[id(descriptor)][1]

    def forget(self, but: Collection[int]) -> None:
        """Drop all signatures but those by components of these identities."""
        self._described = {key: made for key, made in self._described.items() if key in but}

    def _describe(self, descriptor: Descriptor | Trainable, repeats: int) -> Described:
        views, view_ms = self._view((descriptor.view, descriptor.color))
        ready, *fit_s = _fitted(descriptor, views)
        check_signatures(ready.describe(views[:WARM_UP]), len(self), "images")
        runs = [[timed_twice(partial(ready.describe, views[which])) for which in self.batches] for _ in range(repeats)]
        signatures = joined_signatures([found for found, *_ in runs[0]])
        wall, processor = (np.min([[times[i] for _, *times in run] for run in runs], axis=0) for i in (0, 1))
        fit_ms, fit_cpu_ms = (1e3 * seconds / len(self) for seconds in fit_s)
        return Described(
            ready, signatures, fit_ms, fit_cpu_ms, view_ms, self.each_ms(wall), self.each_ms(processor)
        )  # fmt: skip

    def _view(self, wanted: tuple[str, bool]) -> tuple[Bytes, Floats]:
        """The views of all images, and the milliseconds of one."""
        if wanted not in self._views:
            images, camera = self.frames.images, self.frames.camera
            check_views(view_of(images[:WARM_UP], camera, *wanted), len(self))
            parts = [timed(partial(view_of, images[which], camera, *wanted)) for which in self.batches]
            views = np.concatenate([view for view, _ in parts])
            self._views[wanted] = views, self.each_ms([seconds for _, seconds in parts])
        return self._views[wanted]

    def each_ms(self, seconds: Iterable[float]) -> Floats:
        """Milliseconds an image, from the seconds of each batch."""
        return np.array([1e3 * s / (which.stop - which.start) for s, which in zip(seconds, self.batches, strict=True)])


def _fitted(descriptor: Descriptor | Trainable, views: Bytes) -> tuple[Descriptor, float, float]:
    """A descriptor that can describe, and the wall and processor seconds of its training: 0 where there is none."""
    if isinstance(descriptor, Trainable):
        return timed_twice(partial(descriptor.fit, views))
    return descriptor, 0.0, 0.0


def _joined(kept: list[Frames]) -> Frames:
    """Batches of one camera as one."""
    poses = [frames.T_world_camera for frames in kept if frames.T_world_camera is not None]
    return Frames(
        np.concatenate([frames.images for frames in kept]),
        [key for frames in kept for key in frames.keys],
        np.concatenate([frames.stamps_ns for frames in kept]),
        kept[0].camera,
        np.concatenate([frames.plan_index for frames in kept]),
        np.concatenate(poses) if len(poses) == len(kept) else None,
    )
