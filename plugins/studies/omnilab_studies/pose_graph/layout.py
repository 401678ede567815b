"""Viewer layout of the study `pose_graph`."""

from __future__ import annotations

from collections.abc import Sequence

from omnilab.api import Panel, ViewLayout


def layout_of(names: Sequence[str], dots: str) -> ViewLayout:
    """The graph before, the graph after each back end with `dots` (a record's path) behind it, result and log."""
    behind = "dots: the truth" if dots == "truth" else "dots: before"
    after = [Panel("map", f"After {name} ({behind})".replace("_", " "), (dots, f"after/{name}")) for name in names]
    before = Panel("map", "Before (loop closures: green fit, red are off by 6 deviations)", (dots, "before"))
    first = (before, Panel("text", "Result", ("summary",)))
    half = 1 if len(after) < 3 else -(-len(after) // 2)
    columns = [first, tuple(after[:half]), tuple(after[half:])]
    columns[-1 if after[half:] else 1] += (Panel("log", "Log", ("log",)),)
    return ViewLayout([column for column in columns if column])
