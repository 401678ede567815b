"""A study's layout as a Rerun blueprint."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import rerun.blueprint as rrb

from omnilab.api import Floats, Panel, ViewLayout
from omnilab.errors import ConfigError

Extents = Mapping[str, Floats]  # path: corners (2, 3)
BACKGROUND = (14, 18, 24)
SQUARE = 1.07  # width over height of a view in which what is wide fits as soon as what is high does
VIEWS: Mapping[str, Callable[..., rrb.View]] = {
    "map": rrb.Spatial3DView,
    "image": rrb.Spatial2DView,
    "plot": rrb.TimeSeriesView,
    "text": rrb.TextDocumentView,
    "log": rrb.TextLogView,
}


def blueprint(layout: ViewLayout, extents: Extents) -> rrb.Blueprint:
    """The layout's columns side by side, the panels of a column stacked, and time on the timeline `step`.

    `extents` are the corners (2, 3) of what is known to lie at a path; they say from where a map is seen whole.
    """
    columns = [rrb.Vertical(*(_view(panel, extents) for panel in panels)) for panels in layout.columns]
    return rrb.Blueprint(
        rrb.Horizontal(*columns, column_shares=list(layout.widths) or None),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline="step", play_state="paused"),
    )


def _view(panel: Panel, extents: Extents) -> rrb.View:
    if panel.kind not in VIEWS:
        raise ConfigError(f"panel {panel.title!r} is of kind {panel.kind!r}; give one of {', '.join(VIEWS)}")
    contents = [f"+ {absolute(path)}/**" for path in panel.contents]
    if panel.kind == "map" and len(panel.contents) > 1:
        # a distance field is drawn as a surface where it is alone, and as coloured dots among other things
        contents += [f"- {absolute(path)}/surface" for path in panel.contents]
    return VIEWS[panel.kind](name=panel.title, contents=contents, **_view_settings(panel, extents))


def _view_settings(panel: Panel, extents: Extents) -> dict[str, Any]:
    match panel.kind:
        case "map":
            known = [extents[path] for path in map(absolute, panel.contents) if path in extents]
            return {"background": BACKGROUND, "line_grid": False, "eye_controls": eye(known) if known else None}
        case "plot":
            return {"plot_legend": rrb.PlotLegend(rrb.Corner2D.RightTop)}
        case "log":
            return {"columns": rrb.TextLogColumns(text_log_columns=["loglevel", "body"])}
    return {}


def eye(corners: Sequence[Floats], aspect: float = SQUARE) -> rrb.EyeControls3D:
    """From the south and above, far enough to see everything in a view of this width over height."""
    low, high = np.min([pair[0] for pair in corners], 0), np.max([pair[1] for pair in corners], 0)
    center = (low + high) / 2
    wide, deep, _ = high - low
    far = max(
        0.6 * np.linalg.norm(high - low), 0.85 * wide * max(1, SQUARE / aspect), 1.05 * deep
    )  # of what is deep, the near end leaves first
    away = np.array([0.0, -0.6, 1.0]) * far
    return rrb.EyeControls3D(position=center + away, look_target=center)


def absolute(path: str) -> str:
    """The entity of a record's path, which may or may not begin with a slash."""
    return "/" + path.strip("/")
