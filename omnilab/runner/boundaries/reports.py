"""What studies return: a report whose names, figures, tables and map can be kept."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from typing import Any

import numpy as np

from omnilab import api
from omnilab.errors import PluginError
from omnilab.runner.boundaries.images import signatures, state
from omnilab.runner.boundaries.values import ITEMS, Wrong, flag, named, number, poses, sentences, text, typed, whole
from omnilab.runner.run_folder.names import CONFIG, MANIFEST, PROGRESS, STATUS, WARNINGS

OWN_FILES = {STATUS, MANIFEST, CONFIG, WARNINGS, PROGRESS, "metrics.csv", "cost.csv", "map.npz", "latest"}
NO_FILES = re.compile(
    r"run\..*|(con|prn|aux|nul|com\d|lpt\d)(\..*)?"
)  # of the runner and its sinks; devices, to Windows
CELLS = (str, bool, int, float, np.bool_, np.integer, np.floating, np.str_, type(None))
LONGEST_NAME = 200  # bytes, so that all endings fit into what a disk allows


def check_report(found: Any, title: str) -> None:
    """PluginError unless a study returns a report that can be written."""
    try:
        typed(found, api.Report)
        _metrics(found.metrics)
        for name, table in mapping(found.tables, "tables").items():
            _table(table, f"table {name!r}")
        for name, figure in mapping(found.figures, "figures").items():
            if not callable(getattr(figure, "savefig", None)):
                raise Wrong(f"figure {name!r} as {named(figure)}, not as a figure of matplotlib")
        for name, content in mapping(found.files, "files").items():
            text(content, f"file {name!r}", lines=True)
        _file_names(found)
        text(found.summary, "`summary`", lines=True)
        sentences(found.omitted, "`omitted`")
        if found.map is not None:
            _places(found.map)
    except Wrong as wrong:
        raise PluginError(f"{title}: run returns {wrong}; see Report in omnilab.api") from None


def unsound(places: Any) -> str:
    """What keeps places from being a map; "" if nothing does."""
    try:
        _places(places)
    except Wrong as wrong:
        return str(wrong).replace(f" {ITEMS},", " places,").replace("the map's ", "")
    return ""


def mapping(value: Any, name: str) -> Mapping[str, Any]:
    """A value as a mapping from texts; Wrong if it is none."""
    if not isinstance(value, Mapping):
        raise Wrong(f"{name} as {named(value)}, not by name")
    for key in value:
        text(key, f"a name in {name}")
    return value


def _metrics(found: Any) -> None:
    if isinstance(found, str) or not hasattr(found, "__iter__") or not hasattr(found, "__len__"):
        raise Wrong(f"`metrics` as {named(found)}, not as a sequence of metrics")
    names = set()
    for metric in found:
        typed(metric, api.Metric)
        text(metric.name, "the name of a metric")
        name = f"metric {metric.name!r}"
        if not metric.name.strip():
            raise Wrong(f"{name} without a name")
        if metric.name in names:
            raise Wrong(f"{name} twice")
        names.add(metric.name)
        number(metric.value, name, nan=True, inf=True)
        text(metric.unit, f"the unit of {name}")
        text(metric.note, f"the note of {name}", lines=True)
        if metric.interval is not None:
            if not isinstance(metric.interval, tuple | list) or len(metric.interval) != 2:
                raise Wrong(f"the interval of {name} as {named(metric.interval)}, not as its two ends")
            for end in metric.interval:
                number(end, f"an end of the interval of {name}", nan=True, inf=True)


def _table(found: Any, name: str) -> None:
    columns = mapping(found, name)
    for column, values in columns.items():
        if isinstance(values, str | bytes) or not hasattr(values, "__len__") or not hasattr(values, "__getitem__"):
            raise Wrong(f"{name} with column {column!r} as {named(values)}, not as a sequence")
        if isinstance(values, np.ndarray) and (type(values) is not np.ndarray or values.ndim != 1):
            raise Wrong(f"{name} with column {column!r} as {named(values)}, not as one value a row")
        kinds = (
            {values.dtype.type} if isinstance(values, np.ndarray) and values.dtype != object else set(map(type, values))
        )
        if strange := [kind.__name__ for kind in kinds if not issubclass(kind, CELLS)]:
            raise Wrong(f"{name} with {strange[0]} in column {column!r}; use numbers and texts")
    lengths = {column: len(values) for column, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise Wrong(f"{name} with columns of different lengths: {lengths}")


def _file_names(report: api.Report) -> None:
    """Wrong where a name makes no file, one of the run's own files, or one that another name makes, too."""
    names = [f"{name}.csv" for name in report.tables] + [f"{name}.png" for name in report.figures] + list(report.files)
    taken: dict[str, str] = {}
    for name in names:
        key = unicodedata.normalize("NFC", name).casefold()  # on some disks, these are one name
        if (
            not re.fullmatch(r"\w[\w.,;=+@%()\[\] -]*(?<![. ])", unicodedata.normalize("NFC", name))
            or len(name.encode()) > LONGEST_NAME
        ):
            raise Wrong(f"{name!r}, which is no name of a file; use up to {LONGEST_NAME} letters, digits, _ and -")
        if key in OWN_FILES or NO_FILES.fullmatch(key) or key.endswith(".part"):
            raise Wrong(f"{name!r}, which is the name of another file; choose another name")
        if key in taken:
            raise Wrong(f"{name!r} and {taken[key]!r}, which are one file; choose another name")
        taken[key] = name


def _places(found: Any) -> None:
    """A map to be kept."""
    typed(found, api.Places)
    sentences(found.keys, "the map's `keys`")
    if len(found.keys) == 0:
        raise Wrong("a map without places")
    for i, key in enumerate(found.keys):
        text(key, f"the map's key {i}", lines=True)
    signatures(found.signatures, found.keys)
    if found.T_world_camera is not None:
        poses(found.T_world_camera, "the map's `T_world_camera`", len(found.keys))
    state(found.descriptor_state)
    if found.provenance is not None:
        typed(found.provenance, api.Provenance)
        text(found.provenance.camera, "the camera of the map's `provenance`")
        whole(found.provenance.width, "the width of the map's `provenance`")
        whole(found.provenance.height, "the height of the map's `provenance`")
        flag(found.provenance.color, "the color of the map's `provenance`")
        for name in ("world", "world_digest"):
            if getattr(found.provenance, name) is not None:
                text(getattr(found.provenance, name), f"the {name} of the map's `provenance`")
        if found.provenance.elevations_deg is not None:
            typed(found.provenance.elevations_deg, tuple)
            lowest, highest = found.provenance.elevations_deg
            number(lowest, "the lowest elevation of the map's `provenance`")
            number(highest, "the highest elevation of the map's `provenance`")
