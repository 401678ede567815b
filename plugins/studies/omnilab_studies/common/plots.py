"""Figure helpers: blank figures without global state, axes, colours and markers of methods."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from omnilab.api import Bytes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLORS = {"nearest": "#2a9d5c", "second": "#e9a320", "wrong": "#d1403f"}
DPI = 130
CURVES = ["#2563a8", "#d1403f", "#2a9d5c", "#e9a320", "#7d4fa3", "#17a2b0", "#8b5a2b", "#d6579b", "#5b6470", "#9aa51e"]
MARKERS = "osD^vP*Xph"


def blank_figure(width: float, height: float) -> Figure:
    """An empty figure of a size in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=DPI, layout="constrained")


def pixels_of(figure: Figure) -> Bytes:
    """A figure rendered as RGB (H, W, 3), for the logs."""
    raw = BytesIO()
    figure.savefig(raw, format="rgba", dpi=figure.dpi)
    rows, columns = round(figure.bbox.height), round(figure.bbox.width)
    return np.frombuffer(raw.getvalue(), np.uint8).reshape(rows, columns, 4)[..., :3].copy()


def as_floor_plan(axes: Axes, title: str) -> None:
    """Axes x and y in metres, of equal scale."""
    axes.set(xlabel="x [m]", ylabel="y [m]", title=title, aspect="equal")


def plain_axes(axes: Axes) -> None:
    """Axes with a faint grid, and without a frame above and on the right."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25)


def plain_logarithmic(axes: Axes, along: str = "x") -> None:
    """A logarithmic axis with the ticks 1, 2, 5, 10, ... as plain numbers; 1, 2, 3, 4, ... over a short range, 1, 10, ... over a long one.

    The axis stays linear where nothing positive is drawn, for which no logarithmic one can be.
    """
    from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter

    shared = axes.get_shared_x_axes() if along == "x" else axes.get_shared_y_axes()
    if not any(np.isfinite(getattr(one.dataLim, f"minpos{along}")) for one in shared.get_siblings(axes)):
        return
    axes.set(**{f"{along}scale": "log"})
    axis = axes.xaxis if along == "x" else axes.yaxis
    low, high = axis.get_view_interval()
    subs = range(1, 10) if high < 6 * low else (1, 2, 5) if high < 300 * low else (1,)  # neither too few nor too close
    axis.set_major_locator(LogLocator(subs=subs))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_locator(NullLocator())


def style_of(names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """A colour and a marker for each method, the same in all figures; after the colours are used up, hollow markers."""
    return {name: _style(i) for i, name in enumerate(names)}


def _style(i: int) -> dict[str, Any]:
    turn, place = divmod(i, len(CURVES))
    style: dict[str, Any] = {"color": CURVES[place], "marker": MARKERS[(place + 3 * turn) % len(MARKERS)]}
    return style | ({"markerfacecolor": "white"} if turn % 2 else {})
