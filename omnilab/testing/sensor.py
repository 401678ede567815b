"""The conformance check of sensors."""

from __future__ import annotations

from typing import Any

import numpy as np

from omnilab.api import PoseRequest
from omnilab.testing.common import check_common, expect


def check_sensor(sensor: Any, layout: PoseRequest) -> None:
    """A plan as long as its frames, in its order; shapes; deterministic; a part of a plan gives the same images."""
    sensor = check_common("sensor", sensor)
    plan = sensor.plan(layout)
    expect(len(plan) > 0, "the layout has no frames, so nothing can be checked")
    expect(plan.T_world_camera is None or plan.T_world_camera.shape == (len(plan), 4, 4), "poses are not (N, 4, 4)")
    expect(list(plan.keys) == list(sensor.plan(layout).keys), "the same layout is planned otherwise the second time")
    batches = list(sensor.frames(plan))
    order = np.concatenate([b.plan_index for b in batches])
    expect(bool((np.diff(order) > 0).all()), "frames do not come in the plan's order")
    expect(len(order) + sum(len(b.omitted) for b in batches) == len(plan), "frames are missing without a word")
    for batch in batches:
        expect(batch.images.dtype == np.uint8, f"images are {batch.images.dtype}, uint8 is expected")
        expect(batch.images.shape[1:3] == (batch.camera.height, batch.camera.width), "the camera has another size")
        expect(len(batch.keys) == len(batch.stamps_ns) == len(batch), "keys, stamps and images differ in number")
    part = next(iter(sensor.frames(plan.at([int(order[-1])]))))
    expect(np.array_equal(part.images[0], batches[-1].images[-1]), "the last frame is another when requested alone")
    expect(part.keys[0] == batches[-1].keys[-1], "the last frame has another key when requested alone")
