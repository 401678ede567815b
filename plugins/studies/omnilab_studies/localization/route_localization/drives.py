"""Drives: images in order, described by every method, with true positions and courses where these are known."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from omnilab.api import Floats, Ints, Parts, Plan, Recorder, Signatures, Tick
from omnilab.errors import DataError
from omnilab.geometry import heading_of
from omnilab.trajectory.tables import read_table
from omnilab_studies.common.frames import deliver, deliver_queries
from omnilab_studies.common.logs import show_frame
from omnilab_studies.common.methods import Method, describe_all, joined_signatures
from omnilab_studies.common.samples import evenly
from omnilab_studies.localization.route_localization.route import courses


@dataclass(frozen=True)
class RouteDrive:
    """N images of one drive, in order."""

    keys: Sequence[str]  # (N,)
    stamps_ns: Ints  # (N,)
    position_m: Floats  # (N, 3); NaN where it is not known
    heading: Floats  # (N,) in radians, as recorded or the course; NaN where it is not known
    signatures: Mapping[str, Signatures]  # of each descriptor
    omitted: Sequence[str] = ()

    def __len__(self) -> int:
        return len(self.keys)

    def at(self, chosen: Ints) -> RouteDrive:
        """Some of the images."""
        return RouteDrive(
            [self.keys[i] for i in chosen], self.stamps_ns[chosen], self.position_m[chosen], self.heading[chosen],
            {name: own[chosen] for name, own in self.signatures.items()}, self.omitted,
        )  # fmt: skip


@dataclass(frozen=True)
class DriveReader:
    """How drives are described, and what is known of where they went."""

    methods: Sequence[Method]
    record: Recorder
    course_m: float | None  # reach of a course; None: headings are as recorded
    show: int  # queries that go into the logs

    def described(
        self,
        parts: Parts,
        plan: Plan,
        stage: str,
        truth: Floats | None = None,
        seed: int = 0,
        queries: Ints | None = None,
    ) -> RouteDrive:
        """All frames of a plan, described; `truth` (N, 3) are their positions where the sensor has none.

        The run's disturbances apply to `queries`, and to no other drive. Some of the images that are `queries` (Q,) of the
        plan go into the logs, each at the step of its query; none where these are not given.
        """
        parts_of = defaultdict[str, list[Signatures]](list)
        index: list[Ints] = []
        stamps: list[Ints] = []
        omitted = list(plan.omitted)
        shown = {} if queries is None else {int(queries[k]): k for k in evenly(len(queries), self.show).tolist()}
        batches = deliver_queries(parts, plan, self.record, seed) if stage == "queries" else deliver(
            parts, plan, self.record, stage)  # fmt: skip
        for frames in batches:
            found = describe_all(self.methods, frames, self.record)
            for name, signatures in found.items():
                parts_of[name].append(signatures)
            for i in np.flatnonzero([int(step) in shown for step in frames.plan_index]):
                tick = Tick(shown[int(frames.plan_index[i])], int(frames.stamps_ns[i]))
                show_frame(self.record, frames, int(i), next(iter(found.values())).place[i], tick)
            index.append(frames.plan_index)
            stamps.append(frames.stamps_ns)
            omitted += frames.omitted
        if not index:
            raise DataError(f"the sensor delivered none of the {len(plan)} images of the {stage}; give others")
        at = np.concatenate(index)
        position_m, heading = self._poses(plan, truth)
        described = {name: joined_signatures(batches) for name, batches in parts_of.items()}
        return RouteDrive(
            [plan.keys[i] for i in at], np.concatenate(stamps), position_m[at], heading[at], described, omitted
        )

    def _poses(self, plan: Plan, truth: Floats | None) -> tuple[Floats, Floats]:
        """Positions (N, 3) and headings (N,)."""
        if truth is None and plan.T_world_camera is None:
            raise DataError(
                "the images have no positions, and errors along a route are errors of positions; give a positions file,"
                " or study.truth=FILE for the queries"
            )
        position_m = plan.T_world_camera[:, :3, 3] if plan.T_world_camera is not None and truth is None else truth
        assert position_m is not None
        if self.course_m is not None:
            return position_m, courses(position_m, self.course_m)
        if plan.T_world_camera is None:
            return position_m, np.full(len(plan), np.nan)
        return position_m, heading_of(plan.T_world_camera)


def truth_of(file: str, keys: Iterable[str]) -> Floats:
    """Positions (N, 3) of images by a table with the columns image, x_m and y_m; NaN for images that it does not name.

    DataError if it names none of them.
    """
    table = read_table(Path(file))
    known = dict(zip(table.images(), table.position_m(level=True), strict=True))
    found = np.array([known.get(key, np.full(3, np.nan)) for key in keys])
    if not np.isfinite(found).any():
        some = next(iter(known))
        raise DataError(
            f"study.truth={file} names none of the queries ({some}, say); its column image holds their paths below the"
            " folder of the queries"
        )
    return found
