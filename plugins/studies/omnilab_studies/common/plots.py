"""The studies' figures, as matplotlib figures without global state."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from omnilab.api import Bytes, Floats, Ints
from omnilab.metrics import VERDICTS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

COLORS = {"nearest": "#2a9d5c", "second": "#e9a320", "wrong": "#d1403f"}
DPI = 130
SHEET = 6  # images on the sheet of a data set


def _figure(width: float, height: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=DPI, layout="constrained")


def success(verdict: npt.NDArray[np.str_]) -> Figure:
    """Bars of the rates of nearest, second and wrong answers (thesis, figure 4.13)."""
    figure = _figure(4.6, 3.6)
    axes = figure.subplots()
    rates = [100 * float(np.mean(verdict == v)) for v in VERDICTS]
    bars = axes.bar(VERDICTS, rates, color=[COLORS[v] for v in VERDICTS], width=0.62)
    axes.bar_label(bars, [f"{rate:.1f} %" for rate in rates], padding=3)
    axes.set(ylim=(0, 112), ylabel="queries [%]", title=f"Answered place, {len(verdict)} queries")
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def recall(ranks: Ints, precision: Floats, recalled: Floats, place_count: int) -> Figure:
    """Recall among the first N places, where all were ranked, and precision over recall as answers are accepted."""
    figure = _figure(8.4, 3.6)
    among, curve = figure.subplots(1, 2)
    n = np.unique(np.geomspace(1, max(2, place_count // 4), 40).astype(int))
    known = ranks[ranks > 0]
    shares = [100 * float(np.mean(known <= k)) if len(known) else np.nan for k in n]
    among.plot(n, shares, ".-", color=COLORS["nearest"], markersize=4)
    among.set(xscale="log", xlabel="N", ylabel="queries [%]", ylim=(0, 103), title="A true place is among the first N")
    curve.step(100 * recalled, 100 * precision, where="pre", color=COLORS["nearest"])
    curve.set(
        xlabel="recall [%]", ylabel="precision [%]", xlim=(0, 103), ylim=(0, 103), title="As answers are accepted"
    )
    for axes in (among, curve):
        axes.grid(alpha=0.25)
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def pixels_of(figure: Figure) -> Bytes:
    """A figure as an RGB picture (H, W, 3), for the logs."""
    raw = BytesIO()
    figure.savefig(raw, format="rgba", dpi=figure.dpi)
    rows, columns = round(figure.bbox.height), round(figure.bbox.width)
    return np.frombuffer(raw.getvalue(), np.uint8).reshape(rows, columns, 4)[..., :3].copy()


def error_map(
    places_m: Floats, truth_m: Floats, answer_m: Floats, error_m: Floats, verdict: npt.NDArray[np.str_]
) -> Figure:
    """Where queries were taken, coloured by error; a line leads from each wrong one to its answer."""
    figure = _figure(7.2, 5.2)
    axes = figure.subplots()
    axes.plot(places_m[:, 0], places_m[:, 1], ".", color="#c9ced6", markersize=2, label="places", zorder=0)
    top = float(np.quantile(error_m, 0.98)) or 1.0
    shown = axes.scatter(truth_m[:, 0], truth_m[:, 1], c=error_m, s=9, cmap="viridis", vmin=0, vmax=top, zorder=1)
    wrong = verdict == "wrong"
    lines = np.stack([truth_m[wrong, :2], answer_m[wrong, :2], np.full((wrong.sum(), 2), np.nan)], 1).reshape(-1, 2)
    label = f"wrong answers ({wrong.sum()})"
    axes.plot(lines[:, 0], lines[:, 1], "-", color=COLORS["wrong"], linewidth=0.8, label=label, zorder=2)
    figure.colorbar(shown, ax=axes, label="position error [m]", extend="max")
    _as_floor_plan(axes, "Position error of every query")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, fontsize=8, frameon=False)
    return figure


def surface(places_m: Floats, field: Floats, truth_m: Floats, answer_m: Floats) -> Figure:
    """The distance of one query to every place (thesis, figure 4.12)."""
    figure = _figure(7.2, 5.2)
    axes = figure.subplots()
    shown = axes.scatter(places_m[:, 0], places_m[:, 1], c=field, s=_dot_size(places_m), cmap="viridis_r", marker="s")
    axes.plot(*truth_m[:2], "o", markersize=11, markerfacecolor="none", markeredgecolor="white", markeredgewidth=2)
    axes.plot(*truth_m[:2], "o", markersize=11, markerfacecolor="none", markeredgecolor="black", label="query")
    axes.plot(*answer_m[:2], "x", markersize=9, color=COLORS["wrong"], markeredgewidth=2, label="answer")
    figure.colorbar(shown, ax=axes, label="distance of the signatures (bright: alike)")
    _as_floor_plan(axes, f"Distance surface of the query at ({truth_m[0]:.3f}, {truth_m[1]:.3f}) m")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, fontsize=8, frameon=False)
    return figure


def _dot_size(places_m: Floats) -> float:
    """Area of a marker, in points squared, that about fills a grid cell."""
    span = np.ptp(places_m[:, :2], axis=0)
    cell = np.sqrt(max(float(span[0] * span[1]), 1e-9) / len(places_m))
    return float((380 * cell / max(float(span.max()), cell)) ** 2)


def _as_floor_plan(axes: Axes, title: str) -> None:
    axes.set(xlabel="x [m]", ylabel="y [m]", title=title, aspect="equal")


def worst(
    queries: Sequence[Bytes], answered: Sequence[Bytes], error_m: Floats, verdict: npt.NDArray[np.str_]
) -> Figure:
    """The queries with the largest errors (top) and the places they were taken for (bottom)."""
    figure = _figure(2.1 * len(error_m), 4.6)
    axes = figure.subplots(2, len(error_m), squeeze=False)
    for i, (query, answer) in enumerate(zip(queries, answered, strict=True)):
        for row, image in enumerate((query, answer)):
            axes[row, i].imshow(image, cmap="gray", vmin=0, vmax=255)
            axes[row, i].set(xticks=[], yticks=[])
        axes[0, i].set_title(f"{verdict[i]}, {error_m[i]:.2f} m", fontsize=9, color=COLORS[str(verdict[i])])
    axes[0, 0].set_ylabel("query")
    axes[1, 0].set_ylabel("answer")
    figure.suptitle("Largest errors")
    return figure


def views(pictures: Sequence[Bytes], panoramas: Sequence[Bytes], poses: Sequence[Sequence[float]]) -> Figure:
    """Pictures from chosen poses, each above its panorama where there is one (thesis, figures 3.10 to 3.12)."""
    height, width = pictures[0].shape[:2]
    columns = min(len(pictures), 5 if width < 1.5 * height else 2)
    rows = -(-len(pictures) // columns)
    wide = min(15 / columns, 8)  # inches of a picture
    ratios = [wide * height / width + 0.3, *([wide * _aspect(panoramas[0])] if panoramas else [])]
    figure = _figure(wide * columns, rows * sum(ratios))
    axes = figure.subplots(len(ratios) * rows, columns, squeeze=False, height_ratios=ratios * rows)
    for one in axes.flat:
        one.set_axis_off()
    for i, picture in enumerate(pictures):
        row, column = len(ratios) * (i // columns), i % columns
        axes[row, column].imshow(picture, cmap="gray", vmin=0, vmax=255)
        axes[row, column].set_title(_pose_title(poses[i]), fontsize=9)
        if panoramas:
            axes[row + 1, column].imshow(panoramas[i], cmap="gray", vmin=0, vmax=255)
    return figure


def _aspect(picture: Bytes) -> float:
    return float(picture.shape[0] / picture.shape[1])


def _pose_title(pose: Sequence[float]) -> str:
    at = ", ".join(f"{value:g}" for value in pose[:3])
    turns = [f"θ{axis} = {angle:g}°" for axis, angle in zip("xyz", pose[3:], strict=True) if angle]
    return ", ".join([f"({at}) m", *turns])


def cloud(points_m: Floats, colors: Bytes) -> Figure:
    """A point cloud from above and aside (thesis, figure 3.13)."""
    figure = _figure(9, 6)
    axes: Any = figure.add_subplot(projection="3d", computed_zorder=False)
    axes.scatter(*points_m.T, c=colors / 255, s=5, marker="o", linewidths=0)
    span = np.ptp(points_m, axis=0)
    axes.set_box_aspect(np.maximum(span, 0.1 * span.max()))
    axes.view_init(elev=30, azim=-60)
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    return figure


def sheet(images: Sequence[Bytes], numbers: Ints, poses: Floats | None, shown: Floats | None) -> Figure:
    """Some images of a data set, beside all its poses (N, 4, 4): in the plan or, where heights differ, in space."""
    figure = _figure(13.0, 5.6)
    sides = figure.subfigures(1, 2, width_ratios=(1, 1.35), squeeze=False)[0]
    grid = sides[1].subplots(2, SHEET // 2, squeeze=False).ravel()
    for axes in grid:
        axes.set_axis_off()
    for axes, image, n in zip(grid, images, numbers, strict=False):
        axes.imshow(image, cmap="gray", vmin=0, vmax=255)
        axes.set_title(f"{n}", fontsize=9)
    if poses is not None and shown is not None:
        flat = bool(np.ptp(poses[:, 2, 3]) < 1e-6)
        (_plan if flat else _space)(sides[0], poses, shown, numbers)
    return figure


def _plan(figure: SubFigure, poses: Floats, shown: Floats, numbers: Ints) -> None:
    axes = figure.subplots()
    axes.plot(*poses[:, :2, 3].T, ".", color="#8b93a1", markersize=4)
    for pose, n in zip(shown, numbers, strict=True):
        axes.annotate(f"{n}", pose[:2, 3], fontsize=8, color=COLORS["wrong"], xytext=(3, 3), textcoords="offset points")
    axes.quiver(*shown[:, :2, 3].T, *shown[:, :2, 0].T, color=COLORS["wrong"], width=0.006, scale=14)
    axes.margins(0.1)
    _as_floor_plan(axes, f"{len(poses)} poses; arrows: the camera's +x")


def _space(figure: SubFigure, poses: Floats, shown: Floats, numbers: Ints) -> None:
    axes: Any = figure.subplots(subplot_kw={"projection": "3d"})
    axes.plot(*poses[:, :3, 3].T, ".", color="#8b93a1", markersize=4)
    length = 0.12 * max(float(np.ptp(poses[:, :3, 3], axis=0).max()), 0.5)
    axes.quiver(*shown[:, :3, 3].T, *shown[:, :3, 0].T, color=COLORS["wrong"], length=length)
    for pose, n in zip(shown, numbers, strict=True):
        axes.text(*pose[:3, 3], f" {n}", fontsize=8, color=COLORS["wrong"])
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]", title=f"{len(poses)} poses; arrows: the camera's +x")
    axes.set_aspect("equal")
