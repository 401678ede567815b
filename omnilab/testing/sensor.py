"""The conformance check of sensors."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from omnilab.api import Floats, Frames, PathPoses, Plan, PoseRequest, RandomPoses, RecordedPoses
from omnilab.errors import DataError
from omnilab.geometry import planar_poses
from omnilab.image import view_of
from omnilab.testing.common import expect
from omnilab.testing.rules import CannotCheckError, Trial, Work, conform, rule

DRAWN = RandomPoses(3, seed=4)
ALIKE = 0.5  # correlation of two panoramas of one place, the rotation between them undone


def check_sensor(sensor: Any, layout: PoseRequest | None = None) -> None:
    """A plan as long as its frames, in its order; shapes; deterministic; a part of a plan gives the same images.

    Of a live one (`live = True`) fewer frames may come, and none comes twice. Without a `layout` it is asked for a few
    poses drawn at random, or where it has not any pose, for all that was recorded. One that images any pose must turn
    its images the right way.
    """
    conform(SensorTrial(sensor, layout))


class SensorTrial(Trial):
    """A sensor, and the layout that it is asked for."""

    kind = "sensor"

    def __init__(self, sensor: Any, layout: PoseRequest | None = None) -> None:
        super().__init__(sensor)
        self._layout, self.live = layout, bool(getattr(sensor, "live", False))

    @cached_property
    def layout(self) -> PoseRequest:
        """Poses drawn at random where the sensor images any, otherwise all that was recorded."""
        if self._layout is not None:
            return self._layout
        try:
            self.component.plan(DRAWN)
        except DataError:
            return RecordedPoses()
        return DRAWN

    @cached_property
    def plan(self) -> Plan:
        plan: Plan = self.component.plan(self.layout)
        expect(len(plan) > 0, "the layout has no frames, so nothing can be checked")
        return plan

    @cached_property
    def batches(self) -> list[Frames]:
        return list(self.component.frames(self.plan))

    def work(self) -> Work | None:
        if self.live:
            return None
        few = self.plan.at(range(min(3, len(self.plan))))
        return Work(lambda: list(self.given.frames(few)), len(few), "image")

    @rule("plans the same layout the same way each time, with rigid poses where it knows them")
    def plans(self) -> None:
        expect(list(self.plan.keys) == list(self.component.plan(self.layout).keys),
                "the same layout is planned otherwise the second time; draw from the layout's seed alone")  # fmt: skip

    @rule("delivers each planned frame once, in order, or says why not, as uint8 of its camera's size")
    def delivers(self) -> None:
        for batch in self.batches:
            size = (batch.camera.height, batch.camera.width)
            expect(batch.images.shape[1:3] == size, f"images of {batch.images.shape[1:3]} are of a camera of {size}")

    @rule("delivers a frame alone as among others")
    def alone(self) -> None:
        if self.live:
            raise CannotCheckError("what is live comes once")
        last = self.batches[-1]
        part = next(iter(self.component.frames(self.plan.at([int(last.plan_index[-1])]))))
        expect(np.array_equal(part.images[0], last.images[-1]),
                "the last frame is another when requested alone; let it depend on the plan's pose alone")  # fmt: skip
        expect(part.keys[0] == last.keys[-1], "the last frame has another key when requested alone")

    @rule("turns its images clockwise as the camera turns to the left, and lets columns run counter-clockwise")
    def handed(self) -> None:
        ahead, left = self._quarter_turn()
        columns = ahead.shape[1] // 4
        right, wrong = (_alike(left, np.roll(ahead, shift, axis=1)) for shift in (-columns, columns))
        if max(right, wrong) < ALIKE:
            raise CannotCheckError("it does not see the same all around, or too little of it")
        expect(right > wrong, "a turn to the left moves its panoramas the wrong way; mirror the images, or the camera's"
                              " azimuths, so that they grow counter-clockwise seen from above")  # fmt: skip

    def _quarter_turn(self) -> tuple[Floats, Floats]:
        """Panoramas of one place, before and after a quarter turn to the left."""
        if self.layout != DRAWN or self.plan.T_world_camera is None:
            raise CannotCheckError("it images not any pose, so it cannot be turned")
        pose = self.plan.T_world_camera[0]
        turned = pose @ planar_poses([[0.0, 0, 0]], np.pi / 2)[0]
        frames = list(self.component.frames(self.component.plan(PathPoses(np.stack([pose, turned])))))
        views = [view_of(batch.images, batch.camera, "panorama", color=False) for batch in frames]
        ahead, left = np.concatenate(views).astype(float)
        return ahead, left


def _alike(one: Floats, other: Floats) -> float:
    """Correlation of two pictures, where both show something."""
    seen = (one > 0) & (other > 0)
    if seen.mean() < 0.1 or not (one[seen].std() and other[seen].std()):
        return 0.0
    return float(np.corrcoef(one[seen], other[seen])[0, 1])
