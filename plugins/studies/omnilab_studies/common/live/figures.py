"""Figures of latencies."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from omnilab_studies.common.live.pacing import Latencies
from omnilab_studies.common.plots import CURVES, blank_figure, plain_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def latency(latencies: Latencies, dropped: list[int]) -> Figure:
    """Latency of each frame but the first, what of it was work, and which frames were dropped; and its distribution."""
    figure = blank_figure(8.6, 3.4)
    along, share = figure.subplots(1, 2, width_ratios=(2, 1))
    values = latencies.latency_ms[1:]
    along.plot(latencies.steps[1:], values, ".", color=CURVES[0], markersize=3, label="latency")
    along.plot(latencies.steps[1:], latencies.worked_ms[1:], ".", color=CURVES[2], markersize=2, label="of which work")
    if dropped:
        along.plot(dropped, np.zeros(len(dropped)), "|", color=CURVES[1], markersize=8, label=f"{len(dropped)} dropped")
    along.set(xlabel="frame", ylabel="ms", ylim=(0, None), title="From a frame to its answer")
    along.legend(fontsize=8, frameon=False)
    ordered = np.sort(values)
    share.plot(ordered, 100 * np.arange(1, len(ordered) + 1) / max(len(ordered), 1), color=CURVES[0])
    share.set(xlabel="latency [ms]", ylabel="frames answered [%]", xlim=(0, None), ylim=(0, 101))
    for axes in (along, share):
        plain_axes(axes)
    return figure
