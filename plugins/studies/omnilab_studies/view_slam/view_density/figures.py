"""Figures of maps with few views: errors, consistency and time against their number, R against distance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from omnilab_studies.common.plots import blank_figure, plain_axes, plain_logarithmic, style_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BESIDE = [(5, 5), (5, -10), (-18, 5), (-18, -10)]  # points from a mark: where the labels of one method stand
Rows = Sequence[Mapping[str, Any]]


def density(rows: Rows) -> Figure:
    """RMS error, NEES and time of an image against the number of views, each threshold a point."""
    figure = blank_figure(14.0, 4.4)
    panels = figure.subplots(1, 3)
    several = len({row["filter"] for row in rows}) > 1
    names = list(dict.fromkeys((row["filter"], row["label"]) for row in rows))
    styles = style_of([f"{a} {b}" for a, b in names]).values()
    for k, ((name, label), style) in enumerate(zip(names, styles, strict=True)):
        own = sorted(
            (row for row in rows if (row["filter"], row["label"]) == (name, label)), key=lambda row: row["views"]
        )
        shown = (f"{name}, {label}" if several else label).replace("_", " ")
        for axes, key in zip(panels, ("rms_m", "nees", "image_ms"), strict=True):
            axes.plot([row["views"] for row in own], [row[key] for row in own], **style, label=shown)
        for row in own:
            panels[0].annotate(
                f"{row['threshold']:g}", (row["views"], row["rms_m"]), xytext=BESIDE[k % len(BESIDE)],
                textcoords="offset points", fontsize=7, color=style["color"],
            )  # fmt: skip
    panels[0].margins(x=0.12)  # of the labels
    panels[1].axhline(3, color="#8a94a6", linestyle="--")
    odometry = f"Error, thresholds beside; odometry: {rows[0]['odometry_rms_m']:.2g} m"
    panels[0].set(ylabel="RMS position error [m]", title=odometry, ylim=(0, None))
    panels[1].set(ylabel="mean NEES (3 is expected)", title="Consistency", ylim=(0, None))
    panels[2].set(ylabel="processor time of an image [ms]", title="Time", ylim=(0, None))
    for axes in panels:
        axes.set_xlabel("views in the map")
        plain_logarithmic(axes)
        plain_axes(axes)
    figure.legend(
        *panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False, fontsize=8
    )
    return figure


def similarity(rows: Rows) -> Figure:
    """R, as medians with quartiles, the error of bearings and the share of wrong ones, against the distance of two images."""
    figure = blank_figure(14.0, 4.4)
    alike, errors, wrong = figure.subplots(1, 3)
    for name, style in style_of(list(dict.fromkeys(row["method"] for row in rows))).items():
        own = [row for row in rows if row["method"] == name]
        at = [row["distance_m"] for row in own]
        alike.plot(at, [row["similarity"] for row in own], **style, label=name.replace("_", " "))
        low, high = ([row[f"similarity_{end}"] for row in own] for end in ("low", "high"))
        alike.fill_between(at, low, high, color=style["color"], alpha=0.15, linewidth=0)
        errors.plot(at, [row["bearing_error_deg"] for row in own], **style)
        wrong.plot(at, [100 * (row["wrong"] + row["failed"]) for row in own], **style)
    alike.set(ylabel="similarity R, median and quartiles", title="Similarity", ylim=(0, 1))
    errors.set(ylabel="error of the bearing, median [deg]", title="Bearing", ylim=(0, None))
    wrong.set(ylabel="no bearing, or off by more than 5 deg [%]", title="Lost", ylim=(-3, 103))
    for axes in (alike, errors, wrong):
        axes.set_xlabel("distance of two images [m]")
        plain_axes(axes)
    figure.legend(*alike.get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False, fontsize=8)
    return figure
