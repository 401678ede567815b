"""Views of images and their signatures, and the wall time of both."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from omnilab.api import Bytes, Descriptor, Floats, Frames, Recorder, Signatures, Tick, Trainable
from omnilab.errors import DataError
from omnilab.image import view_of
from omnilab_studies.common.describing import check_views
from omnilab_studies.common.logs import show_picture
from omnilab_studies.common.methods import joined_signatures, settings_of
from omnilab_studies.common.scores import known_poses
from omnilab_studies.common.timing import timed

View = tuple[str, bool]  # `view` and `color` of a descriptor
BATCH = 64  # images described at once
WARM_UP = 2  # images described before time is taken: the first call may compile


@dataclass(frozen=True)
class TimedImages:
    """N images in every view that a descriptor wants, and the milliseconds of a view per image."""

    views: Mapping[View, Bytes]
    view_ms: Mapping[View, float]
    position_m: Floats  # (N, 3)
    omitted: Sequence[str]

    @classmethod
    def of(
        cls, batches: Iterable[Frames], total: int, descriptors: Mapping[str, Descriptor], record: Recorder
    ) -> TimedImages:
        """The views of all frames of the batches, `total` of them; DataError if there are none, or no poses."""
        wanted = {(descriptor.view, descriptor.color) for descriptor in descriptors.values()}
        views: dict[View, list[Bytes]] = {view: [] for view in wanted}
        seconds = dict.fromkeys(wanted, 0.0)
        poses: list[Floats] = []
        omitted: list[str] = []
        for frames in batches:
            if len(frames):
                show_picture(record, frames, 0, Tick(int(frames.plan_index[0]), int(frames.stamps_ns[0])))
            for view in wanted:
                seen, spent = timed(partial(view_of, frames.images, frames.camera, *view))
                if not views[view]:
                    check_views(seen, total)
                views[view].append(seen)
                seconds[view] += spent
            poses.append(known_poses(frames.T_world_camera, "images")[:, :3, 3])
            omitted += frames.omitted
        if not poses:
            raise DataError("the sensor delivered no images for the study's layout; ask for others")
        position_m = np.concatenate(poses)
        each = {view: 1e3 * spent / len(position_m) for view, spent in seconds.items()}
        return cls({view: np.concatenate(parts) for view, parts in views.items()}, each, position_m, omitted)

    def __len__(self) -> int:
        return len(self.position_m)


@dataclass(frozen=True)
class TimedSignatures:
    """Signatures of places and queries by one descriptor, and the time of training and description."""

    places: Signatures
    queries: Signatures
    settings: str
    fit_s: float
    view_ms: float  # per query
    describe_ms: float  # per image

    @classmethod
    def by(cls, descriptor: Descriptor, places: TimedImages, queries: TimedImages) -> TimedSignatures:
        """Described by a descriptor, a trainable one trained on the places first."""
        view = (descriptor.view, descriptor.color)
        fit_s = 0.0
        if isinstance(descriptor, Trainable):
            trainable = descriptor
            descriptor, fit_s = timed(lambda: trainable.fit(places.views[view]))
        descriptor.describe(places.views[view][:WARM_UP])
        (of_places, of_queries), seconds = timed(
            lambda: [_in_batches(descriptor, p.views[view]) for p in (places, queries)]
        )
        each = 1e3 * seconds / (len(places) + len(queries))
        return cls(of_places, of_queries, settings_of(descriptor), fit_s, queries.view_ms[view], each)


def _in_batches(descriptor: Descriptor, images: Bytes) -> Signatures:
    return joined_signatures([descriptor.describe(images[i : i + BATCH]) for i in range(0, len(images), BATCH)])
