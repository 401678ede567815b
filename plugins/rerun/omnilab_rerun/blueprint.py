"""A study's layout as a Rerun blueprint."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
import rerun.blueprint as rrb

from omnilab.api import Floats, Panel, RunResult, ViewLayout
from omnilab.errors import ConfigError
from omnilab.run_header import HEADER
from omnilab_rerun.records_seen import RecordsSeen

HEADER_SHARE, ERROR_SHARE, TRACEBACK_SHARE = 0.13, 0.18, 0.4  # of the height: three lines of 900 pixels, four, many
BACKGROUND = (14, 18, 24)
SQUARE = 1.07  # width over height of a view
WINDOW, TITLE = (1600, 830), 28  # pixels: of all panels in a picture of the usual size, and the height of a title
FOV_RAD = np.radians(55)  # Rerun's, of a view's height
MARGIN = 1.05  # around what is seen
NEAREST_M = 0.5
STEEP, LOW = (np.array([0, -far, up]) / np.hypot(far, up) for far, up in ((0.6, 1.0), (1.0, 0.5)))  # where eyes are
VIEWS: Mapping[str, Callable[..., rrb.View]] = {
    "map": rrb.Spatial3DView,
    "image": rrb.Spatial2DView,
    "plot": rrb.TimeSeriesView,
    "text": rrb.TextDocumentView,
    "log": rrb.TextLogView,
}


def blueprint(
    layout: ViewLayout, seen: RecordsSeen, ended: RunResult | None = None, empty: bool = True
) -> rrb.Blueprint:
    """The run's header, and below it the layout's columns side by side, each with its panels from top to bottom.

    What was seen of the records says from where a map is seen whole, and where a plot of times ends. The header of a run
    that has failed has room for its error. Panels of which nothing was logged are shown only if `empty` is. Time is on the timeline `step`, and its end is shown.
    """
    header = HEADER_SHARE
    if ended and ended.error:
        header = TRACEBACK_SHARE if ended.traceback else ERROR_SHARE
    widths = np.array(layout.widths or [1] * len(layout.columns), float)
    columns = [
        rrb.Vertical(*(_view(panel, seen, _aspect(share, (1 - header) / len(panels)), empty) for panel in panels))
        for panels, share in zip(layout.columns, widths / widths.sum(), strict=False)
    ]
    top = rrb.TextDocumentView(origin=absolute(HEADER), name="Run", titlebar=False, visible=seen.holds([HEADER]))
    body = rrb.Horizontal(*columns, column_shares=list(layout.widths) or None)
    return rrb.Blueprint(
        rrb.Vertical(top, body, row_shares=[header, 1 - header]),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline="step", play_state="following"),
    )


def _aspect(width: float, height: float) -> float:
    """Width over height of a view with these shares of a window of the usual size."""
    return width * WINDOW[0] / max(1.0, height * WINDOW[1] - TITLE)


def _view(panel: Panel, seen: RecordsSeen, aspect: float, empty: bool) -> rrb.View:
    if panel.kind not in VIEWS:
        raise ConfigError(f"panel {panel.title!r} is of kind {panel.kind!r}; give one of {', '.join(VIEWS)}")
    contents = [f"+ {absolute(path)}/**" for path in panel.contents]
    if panel.kind == "map" and len(panel.contents) > 1:
        # a distance field is drawn as a surface where it is alone, and as coloured dots among other things
        contents += [f"- {absolute(path)}/surface" for path in panel.contents]
    options = _view_settings(panel, seen, aspect) | {"visible": empty or seen.holds(panel.contents)}
    return VIEWS[panel.kind](name=panel.title, contents=contents, **options)


def _view_settings(panel: Panel, seen: RecordsSeen, aspect: float) -> dict[str, Any]:
    match panel.kind:
        case "map":
            corners = seen.corners(panel.contents)
            back = LOW if seen.is_surface(panel.contents) else STEEP
            seen_from = None if corners is None else eye([corners], aspect, back)
            return {"background": BACKGROUND, "line_grid": False, "eye_controls": seen_from}
        case "plot":
            tops = [top for path in panel.contents if (top := seen.top(path)) is not None]
            end = rrb.ScalarAxis(range=(0.0, max(top for top, _ in tops))) if tops else None
            return {"plot_legend": rrb.PlotLegend(rrb.Corner2D.RightTop), "axis_y": end}
        case "log":
            return {"columns": rrb.TextLogColumns(text_log_columns=["loglevel", "body"])}
    return {}


def eye(corners: Sequence[Floats], aspect: float = SQUARE, back: Floats = STEEP) -> rrb.EyeControls3D:
    """From the south and above, just far enough to see everything in a view of this width over height.

    `back`: unit vector (3,) from what is seen to the eye.
    """
    low, high = np.min([pair[0] for pair in corners], 0), np.max([pair[1] for pair in corners], 0)
    center = (low + high) / 2
    box = np.array(list(product(*zip(low, high, strict=True)))) - center
    right = np.array([1.0, 0.0, 0.0])
    half = np.tan(FOV_RAD / 2) * np.array([aspect, 1.0]) / MARGIN
    far = (np.abs(box @ np.stack([right, np.cross(back, right)], 1)) / half + (box @ back)[:, None]).max()
    return rrb.EyeControls3D(position=center + max(far, NEAREST_M) * back, look_target=center)


def absolute(path: str) -> str:
    """The entity of a record's path, which may or may not begin with a slash."""
    return "/" + path.strip("/")
