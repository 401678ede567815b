"""A study's layout as a layout file of Foxglove, bound to the topics that the log holds.

The form is that of layouts exported by Foxglove and Lichtblick: a tree of splits whose leaves name panels, and the settings
of each panel by its name, `TYPE!ID`. A panel for which the log holds no topic is left out.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from omnilab.api import Floats, Panel, ViewLayout
from omnilab.errors import ConfigError
from omnilab_mcap.messages import WORLD
from omnilab_mcap.shown import Shown

Json = dict[str, Any]
TYPES = {
    "map": "3D",
    "image": "Image",
    "plot": "Plot",
    "text": "RosOut",
    "log": "RosOut",
}  # by kind of panel, Foxglove's
TAKEN = {
    "3D": {"foxglove.SceneUpdate", "foxglove.PointCloud", "foxglove.PosesInFrame", "foxglove.PoseInFrame"},
    "Image": {"foxglove.CompressedImage", "foxglove.RawImage"},
    "Plot": {"omnilab.Scalar"},
    "RosOut": {"foxglove.Log"},
}
FOVY_DEG = 45.0
TILT_DEG = math.degrees(math.atan(0.6))  # of the eye, from straight above towards the south: as in the Rerun recording
SCREEN = 16 / 9  # width over height of the window that the eye's distance is reckoned for
PLACES, POINTS = "#8c9bb4", "#ffc857"
BACKGROUND = "#0e1218"


def check_panels(layout: ViewLayout) -> None:
    """ConfigError for a panel of an unknown kind."""
    for panel in (panel for column in layout.columns for panel in column):
        if panel.kind not in TYPES:
            raise ConfigError(f"panel {panel.title!r} is of kind {panel.kind!r}; give one of {', '.join(TYPES)}")


def foxglove_layout(layout: ViewLayout, topics: Mapping[str, Shown]) -> str | None:
    """The text of a layout file; None if no panel would show anything. `topics` is what the log holds."""
    widths = list(layout.widths) or [1.0] * len(layout.columns)
    settings: dict[str, Json] = {}
    columns, shares = list[Any](), list[float]()
    for number, (panels, width) in enumerate(zip(layout.columns, widths, strict=True), start=1):
        bound = [(panel, found) for panel in panels if (found := dict(_shown_in(panel, topics)))]
        if not bound:
            continue
        aspect = SCREEN * width / sum(widths) * len(bound)
        names = [f"{TYPES[panel.kind]}!c{number}p{row}" for row, (panel, _) in enumerate(bound, start=1)]
        for name, (panel, found) in zip(names, bound, strict=True):
            title = {"foxglovePanelTitle": panel.title, "lichtblickPanelTitle": panel.title}
            settings[name] = _settings(panel, found, aspect) | title
        columns.append(_split(names, [1.0] * len(names), "column"))
        shares.append(width)
    if not columns:
        return None
    whole = {
        "configById": settings,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _split(columns, shares, "row"),
    }
    return json.dumps(whole, indent=1, ensure_ascii=False) + "\n"


def _shown_in(panel: Panel, topics: Mapping[str, Shown]) -> Iterator[tuple[str, Shown]]:
    """The topics at or below a panel's paths that it can show, in the order of its paths."""
    for path in panel.contents:
        own = f"/{path.strip('/')}"
        for topic, shown in topics.items():
            if (topic == own or topic.startswith(f"{own}/")) and shown.schema in TAKEN[TYPES[panel.kind]]:
                yield topic, shown


def _split(parts: Sequence[Any], shares: Sequence[float], direction: str) -> Any:
    """A tree in which each split parts the first from the rest, by percent."""
    if len(parts) == 1:
        return parts[0]
    return {
        "direction": direction,
        "first": parts[0],
        "second": _split(parts[1:], shares[1:], direction),
        "splitPercentage": round(100 * shares[0] / sum(shares), 2),
    }


def _settings(panel: Panel, topics: Mapping[str, Shown], aspect: float) -> Json:
    match TYPES[panel.kind]:
        case "3D":
            return _scene(topics, aspect)
        case "Image":
            return _picture(*next(iter(topics.items())))
        case "Plot":
            return _plot(topics)
    return {"searchTerms": [], "minLogLevel": 1, "topicToRender": next(iter(topics)), "nameFilter": {}}


def _scene(topics: Mapping[str, Shown], aspect: float) -> Json:
    """Seen from the south and above, whole in a panel of this width over height."""
    corners = [shown.corners_m for shown in topics.values() if shown.corners_m is not None]
    low, high = np.min([pair[0] for pair in corners], 0), np.max([pair[1] for pair in corners], 0)
    size_m = max(float(np.linalg.norm(high - low)), 1.0)
    return {
        "cameraState": _eye((low + high) / 2, size_m / 2 / math.sin(math.radians(FOVY_DEG / 2)) / min(1.0, aspect)),
        "followMode": "follow-none",
        "followTf": WORLD,
        "scene": {
            "backgroundColor": BACKGROUND,
            "transforms": {"showLabel": False, "axisScale": round(size_m / 10, 3)},
        },
        "transforms": {},
        "topics": {topic: _drawn(shown, size_m) for topic, shown in topics.items()},
        "layers": {},
        "imageMode": {},
    }


def _eye(target_m: Floats, distance_m: float) -> Json:
    return {
        "perspective": True,
        "distance": round(distance_m, 3),
        "phi": round(TILT_DEG, 3),
        "thetaOffset": 0,
        "targetOffset": [round(x, 3) for x in target_m.tolist()],  # from the frame that is followed
        "target": [0, 0, 0],
        "targetOrientation": [0, 0, 0, 1],
        "fovy": FOVY_DEG,
        "near": round(distance_m / 1000, 6),
        "far": round(10 * distance_m, 3),
    }


def _drawn(shown: Shown, size_m: float) -> Json:
    """How a topic is drawn in a scene of this size."""
    arrow = [round(size_m / by, 4) for by in (30, 150, 150)]
    match shown.schema:
        case "foxglove.PosesInFrame":
            return {"visible": True, "type": "arrow", "arrowScale": arrow, "gradient": [PLACES, PLACES]}
        case "foxglove.PoseInFrame":
            return {"visible": True, "type": "axis", "axisScale": round(size_m / 10, 3)}
        case "foxglove.PointCloud" if shown.range is not None:
            low, high = shown.range
            field = {"colorField": "distance", "colorMode": "colormap", "colorMap": "turbo"}
            return {"visible": True, "pointSize": 8, **field, "minValue": low, "maxValue": high}
        case "foxglove.PointCloud" if shown.colored:
            return {"visible": True, "pointSize": 2, "colorMode": "rgba-fields", "colorField": "red"}
        case "foxglove.PointCloud":
            return {"visible": True, "pointSize": 5, "colorMode": "flat", "flatColor": POINTS}
    return {"visible": True}


def _picture(topic: str, shown: Shown) -> Json:
    mode: Json = {"imageTopic": topic, "synchronize": False}
    if shown.range is not None:  # of a matrix of numbers
        mode |= {"colorMode": "colormap", "colorMap": "turbo"}
        mode |= dict(zip(("minValue", "maxValue"), shown.range, strict=True))
    return {
        "cameraState": _eye(np.zeros(3), 20.0),
        "followMode": "follow-pose",
        "scene": {},
        "transforms": {},
        "topics": {},
        "layers": {},
        "imageMode": mode,
    }


def _plot(topics: Mapping[str, Shown]) -> Json:
    """Curves over the study's step where all have the same steps, and over time otherwise: a plot has one x axis."""
    plot: Json = {
        "paths": [_curve(topic, shown) for topic, shown in topics.items()],
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "showLegend": True,
        "legendDisplay": "floating",
        "showPlotValuesInLegend": False,
        "isSynced": False,
        "xAxisVal": "timestamp",
        "sidebarDimension": 240,
    }
    if len({shown.steps for shown in topics.values()}) == 1:
        plot |= {"xAxisVal": "custom", "xAxisPath": {"value": f"{next(iter(topics))}.step", "enabled": True}}
        plot |= {"xAxisLabel": "step"}
    return plot


def _curve(topic: str, shown: Shown) -> Json:
    curve = {
        "value": f"{topic}.value",
        "enabled": True,
        "timestampMethod": "receiveTime",
        "label": f"{topic.rsplit('/', 1)[-1]} [{shown.unit}]",
    }
    return curve | ({} if shown.color is None else {"color": "#{:02x}{:02x}{:02x}".format(*shown.color)})
