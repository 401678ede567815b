"""How several runs look side by side: what differs, their maps, a plot for each error with a curve a run."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from omnilab.api import Panel
from omnilab.hooks import RunSummary
from omnilab_rerun.blueprint import BACKGROUND, absolute, eye
from omnilab_rerun.colors import RUNS
from omnilab_rerun.several.merging import APPLICATION, RECORDING, ShownRun

HEADER = "/omnilab_view"
METRICS = 3  # as tables of runs show
MOST_ROWS = 12  # of what differs
MOST_PLOTS = 4
MAPS_IN_A_ROW = 4
LONGEST = 60  # characters of a value
TITLED_IN_A_ROW = 3  # maps in whose titles there is room for more than the run's name


def write_comparison(
    runs: Sequence[ShownRun], summaries: Sequence[RunSummary], different: Mapping[str, Sequence[str]], target: Path
) -> None:
    """Write the header, the runs' colours and the layout, as a part of the merged recording."""
    stream = rr.RecordingStream(APPLICATION, recording_id=RECORDING)
    stream.save(target, default_blueprint=_layout(runs))
    stream.send_recording_name(f"{len(runs)} runs")
    text = header(runs, summaries, different)
    stream.log(HEADER, rr.TextDocument(text, media_type="text/markdown"), static=True)
    for run in runs:
        for panel in run.contents.plots:
            for curve in run.contents.shown(panel):
                name = run.name if len(run.contents.shown(panel)) == 1 else f"{run.name}: {curve.rpartition('/')[2]}"
                stream.log(run.root + curve, rr.SeriesLines(names=name, colors=run.color, widths=2.0), static=True)
        if corners := list(run.contents.extents.values()):
            (x0, y0, _), (x1, y1, z) = np.min([c[0] for c in corners], 0), np.max([c[1] for c in corners], 0)
            frame = [[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z], [x0, y0, z]]
            lines = rr.LineStrips3D([frame], colors=run.color, radii=rr.Radius.ui_points(2.0))
            stream.log(f"{run.root}/frame", lines, static=True)
    stream.disconnect()


def header(runs: Sequence[ShownRun], summaries: Sequence[RunSummary], different: Mapping[str, Sequence[str]]) -> str:
    """What differs, and the main metrics, as a table in Markdown: a row a run."""
    colors = {color: name for name, color in RUNS.items()}
    metrics = [name for name in summaries[0].metrics if all(name in each.metrics for each in summaries)][:METRICS]
    names = list(different)[:MOST_ROWS]
    common = Path(os.path.commonpath([summary.folder.parent for summary in summaries]))
    rows = [["run", "color", *names, *metrics, "status", "folder"]]
    for i, (run, summary) in enumerate(zip(runs, summaries, strict=True)):
        values = [different[name][i][:LONGEST] for name in names]
        numbers = [f"{summary.metrics[name]:.4g}" for name in metrics]
        folder = str(summary.folder.relative_to(common))
        rows.append([f"**{run.name}**", colors[run.color], *values, *numbers, summary.state, folder])
    table = ["| " + " | ".join(_cell(text) for text in row) + " |" for row in rows]
    table.insert(1, "|" + " --- |" * len(rows[0]))
    notes = [f"Folders are those in `{common}`."]
    if len(different) > len(names):
        notes.append(f"{len(different) - len(names)} more settings differ.")
    elif not different:
        notes.append("Their settings are the same.")
    return "\n".join(table) + "\n\n" + "\n\n".join(notes)


def _cell(text: str) -> str:
    return " ".join(text.replace("|", "\\|").split())


def common_plots(runs: Sequence[ShownRun]) -> list[Panel]:
    """The plots that the layouts of two runs or more have, be it that some have no curve yet."""
    found: dict[tuple[str, ...], list[Panel]] = {}
    for run in runs:
        for panel in run.contents.panels:
            if panel.kind == "plot":
                found.setdefault(tuple(panel.contents), []).append(panel)
    common = [panels[0] for panels in found.values() if len(panels) >= min(2, len(runs))]
    return [panel for panel in common if any(run.contents.shown(panel) for run in runs)]


def not_common(runs: Sequence[ShownRun], summaries: Sequence[RunSummary]) -> list[str]:
    """What is not shown, in sentences: curves of one run alone, more plots than fit, maps that some runs lack."""
    plots = common_plots(runs)
    shown = {tuple(panel.contents) for panel in plots[:MOST_PLOTS]}
    studies = list(dict.fromkeys(summary.components.get("study", "unknown") for summary in summaries))
    found = [f"the runs are of different studies ({', '.join(studies)}): what they share is shown"] * (len(studies) > 1)
    for run in runs:
        if left := [panel.title for panel in run.contents.plots if tuple(panel.contents) not in shown]:
            found.append(f"of {run.name} no plot shows {', '.join(left)}; view it alone")
        if not run.contents.maps:
            found.append(f"{run.name} has no map")
    return found


def _layout(runs: Sequence[ShownRun]) -> rrb.Blueprint:
    mapped = [run for run in runs if run.contents.maps]
    maps = [run.contents.maps for run in mapped]
    in_a_row = min(len(runs), MAPS_IN_A_ROW)
    rows = 2 if len(runs) <= MAPS_IN_A_ROW and min(map(len, maps), default=0) > 1 else 1
    aspect = (4.5 if rows == 2 else 3.6 * -(-len(runs) // in_a_row)) / in_a_row
    plots = [_plot(runs, panel, i == 0) for i, panel in enumerate(common_plots(runs)[:MOST_PLOTS])]
    first = rrb.Horizontal(
        rrb.TextDocumentView(origin=HEADER, name="Runs"), *plots, column_shares=[1.9] + [1] * len(plots)
    )
    parts: list[tuple[float, rrb.Container]] = [(2.6, first)]
    for panels, share in zip(zip(*(each[:rows] for each in maps), strict=True), (3.4, 2.2), strict=False):
        views = [
            _map(run, panel, aspect, in_a_row <= TITLED_IN_A_ROW) for run, panel in zip(mapped, panels, strict=True)
        ]
        parts.append((share, rrb.Grid(*views, grid_columns=in_a_row)))
    return rrb.Blueprint(
        rrb.Vertical(*(part for _, part in parts), row_shares=[share for share, _ in parts]),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline="step", play_state="following"),
    )


def _map(run: ShownRun, panel: Panel, aspect: float, titled: bool) -> rrb.View:
    paths = [absolute(path) for path in panel.contents]
    known = list(run.contents.extents.values())
    inside = [f"+ {run.root}{path}/**" for path in paths]
    if any(path in run.contents.extents for path in paths):
        inside.append(f"+ {run.root}/frame")
    if len(paths) > 1:
        inside += [f"- {run.root}{path}/surface" for path in paths]
    return rrb.Spatial3DView(
        origin=run.root,
        contents=inside,
        name=f"{run.name}: {panel.title}" if titled else run.name,
        background=BACKGROUND,
        line_grid=False,
        eye_controls=eye(known, aspect) if known else None,
    )


def _plot(runs: Sequence[ShownRun], panel: Panel, legend: bool) -> rrb.View:
    """A curve a run; the names of the colours, which are the same in all plots, in the first."""
    units = {run.contents.curves[curve] for run in runs for curve in run.contents.shown(panel)}
    unit = f" [{units.pop()}]" if len(units) == 1 else ""
    contents = [f"+ {run.root}{absolute(path)}/**" for run in runs for path in panel.contents]
    named = rrb.PlotLegend(rrb.Corner2D.RightTop, visible=legend)
    return rrb.TimeSeriesView(name=panel.title + unit, contents=contents, plot_legend=named)
