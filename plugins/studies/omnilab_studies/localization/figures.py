"""Figures of localisation: rates, errors on the floor plan, recall, one distance surface."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from omnilab.api import Floats, Ints
from omnilab.metrics import VERDICTS
from omnilab_studies.common.localization_metrics import curve, true_ranks
from omnilab_studies.common.plots import COLORS, as_floor_plan, blank_figure, plain_axes, plain_logarithmic

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from omnilab_studies.common.localization_run import LocalizationRun
    from omnilab_studies.common.scores import ScoredEstimates


def localization_figures(run: LocalizationRun, scored: ScoredEstimates) -> dict[str, Figure]:
    """Success, errors on the floor plan, recall and precision, and the distance surface of one query."""
    drawn = {
        "success": success(scored.verdict),
        "error_map": error_map(run.places_m, scored.truth_m, scored.answer_m, scored.error_m, scored.verdict),
        "recall": recall(true_ranks(scored), *curve(scored), len(run.places)),
    }
    example = run.example
    if example.field is not None and example.truth_m is not None and example.answer_m is not None:
        drawn["distance_surface"] = surface(run.places_m, example.field, example.truth_m, example.answer_m)
    return drawn


def success(verdict: npt.NDArray[np.str_]) -> Figure:
    """Bars of the rates of nearest, second and wrong answers (thesis, figure 4.13)."""
    figure = blank_figure(4.6, 3.6)
    axes = figure.subplots()
    rates = [100 * float(np.mean(verdict == v)) for v in VERDICTS]
    bars = axes.bar(VERDICTS, rates, color=[COLORS[v] for v in VERDICTS], width=0.62)
    axes.bar_label(bars, [f"{rate:.1f} %" for rate in rates], padding=3)
    axes.set(ylim=(0, 112), ylabel="queries [%]", title=f"Answered place, {len(verdict)} queries")
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def recall(ranks: Ints, precision: Floats, recalled: Floats, place_count: int) -> Figure:
    """Recall@N over N, where all places were ranked, and the precision-recall curve of the estimates."""
    figure = blank_figure(8.4, 3.6)
    among, curve = figure.subplots(1, 2)
    n = np.unique(np.geomspace(1, max(2, place_count // 4), 40).astype(int))
    known = ranks[ranks > 0]
    shares = [100 * float(np.mean(known <= k)) if len(known) else np.nan for k in n]
    among.plot(n, shares, ".-", color=COLORS["nearest"], markersize=4)
    among.set(xlabel="N", ylabel="queries [%]", ylim=(0, 103), title="A true place is among the first N")
    curve.step(100 * recalled, 100 * precision, where="pre", color=COLORS["nearest"])
    curve.set(
        xlabel="recall [%]", ylabel="precision [%]", xlim=(0, 103), ylim=(0, 103), title="As answers are accepted"
    )
    for axes in (among, curve):
        plain_axes(axes)
    plain_logarithmic(among)
    return figure


def error_map(
    places_m: Floats, truth_m: Floats, answer_m: Floats, error_m: Floats, verdict: npt.NDArray[np.str_]
) -> Figure:
    """Position error of every query on the floor plan; a line leads from each wrong one to its answer."""
    figure = blank_figure(7.2, 5.2)
    axes = figure.subplots()
    axes.plot(places_m[:, 0], places_m[:, 1], ".", color="#c9ced6", markersize=2, label="places", zorder=0)
    top = float(np.quantile(error_m, 0.98)) or 1.0
    shown = axes.scatter(truth_m[:, 0], truth_m[:, 1], c=error_m, s=9, cmap="viridis", vmin=0, vmax=top, zorder=1)
    wrong = verdict == "wrong"
    lines = np.stack([truth_m[wrong, :2], answer_m[wrong, :2], np.full((wrong.sum(), 2), np.nan)], 1).reshape(-1, 2)
    label = f"wrong answers ({wrong.sum()})"
    axes.plot(lines[:, 0], lines[:, 1], "-", color=COLORS["wrong"], linewidth=0.8, label=label, zorder=2)
    figure.colorbar(shown, ax=axes, label="position error [m]", extend="max")
    as_floor_plan(axes, "Position error of every query")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, fontsize=8, frameon=False)
    return figure


def surface(places_m: Floats, field: Floats, truth_m: Floats, answer_m: Floats) -> Figure:
    """Distance surface: the distance of one query to every place (thesis, figure 4.12)."""
    figure = blank_figure(7.2, 5.2)
    axes = figure.subplots()
    shown = axes.scatter(places_m[:, 0], places_m[:, 1], c=field, s=_dot_size(places_m), cmap="viridis_r", marker="s")
    axes.plot(*truth_m[:2], "o", markersize=11, markerfacecolor="none", markeredgecolor="white", markeredgewidth=2)
    axes.plot(*truth_m[:2], "o", markersize=11, markerfacecolor="none", markeredgecolor="black", label="query")
    axes.plot(*answer_m[:2], "x", markersize=9, color=COLORS["wrong"], markeredgewidth=2, label="answer")
    figure.colorbar(shown, ax=axes, label="distance of the signatures (bright: alike)")
    as_floor_plan(axes, f"Distance surface of the query at ({truth_m[0]:.3f}, {truth_m[1]:.3f}) m")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, fontsize=8, frameon=False)
    return figure


def _dot_size(places_m: Floats) -> float:
    """Area of a marker, in points squared, that about fills a grid cell."""
    span = np.ptp(places_m[:, :2], axis=0)
    cell = np.sqrt(max(float(span[0] * span[1]), 1e-9) / len(places_m))
    return float((380 * cell / max(float(span.max()), cell)) ** 2)
