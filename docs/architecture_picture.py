"""Draws docs/architecture.png, which way imports point: uv run python docs/architecture_picture.py"""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

INK, LINE = "#1f2a37", "#5b6b7f"
COLORS = {"plugin": "#dcebfa", "runner": "#fbe5d6", "contract": "#dff2e1", "base": "#eef0f3"}


def box(axes: Axes, x: float, y: float, width: float, height: float, title: str, text: str, kind: str) -> None:
    """A rounded box from its lower left corner, with a bold title above its text."""
    axes.add_patch(
        FancyBboxPatch(
            (x, y), width, height, boxstyle="round,pad=0,rounding_size=0.12", fc=COLORS[kind], ec=LINE, lw=1.1
        )
    )
    above = y + height / 2 + (0.17 if text else 0)
    axes.text(x + width / 2, above, title, ha="center", va="center", weight="bold", size=9.2, color=INK)
    axes.text(x + width / 2, y + height / 2 - 0.17, text, ha="center", va="center", size=8.5, color=INK)


def arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float], style: str = "-") -> None:
    """An import, from who imports to what is imported; dashed: found by name while running."""
    axes.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": LINE, "lw": 1.4, "ls": style})


def draw() -> Figure:
    """Plugins and the runner above the contract, the contract above numpy."""
    figure = Figure(figsize=(11, 5.6), dpi=130, layout="constrained")
    axes = figure.subplots()
    axes.set(xlim=(0, 11), ylim=(0, 5.7), aspect="equal")
    axes.set_axis_off()
    plugins = {
        "appearance": "descriptors ... odometries", "studies": "by family", "mirror": "virtual sensors",
        "recordings": "image folders", "slam": "GTSAM", "rerun": "sink, view", "mcap": "sink",
    }  # fmt: skip
    for i, (name, text) in enumerate(plugins.items()):
        x = 0.1 + 1.07 * i
        box(axes, x, 3.9, 0.97, 1.15, name, text.replace(" ... ", "\n... ").replace("virtual ", "virtual\n"), "plugin")
        arrow(axes, (x + 0.485, 3.88), (x + 0.485, 2.92))
    axes.text(
        0.1, 5.3, "plugins: a distribution each; none imports another, none imports the runner", size=9.5, color=INK
    )
    box(
        axes, 8.3, 3.9, 2.6, 1.15, "omnilab.runner", "command line, Hydra, build,\nexecute, run folder, cache", "runner"
    )
    axes.text(8.3, 5.3, "omnilab, the command", size=9.5, color=INK)
    arrow(axes, (8.28, 4.47), (7.55, 4.47), "--")
    axes.text(7.93, 4.6, "finds", ha="center", size=8.5, color=LINE)
    arrow(axes, (9.0, 3.88), (9.0, 2.92))
    box(axes, 9.7, 1.75, 1.2, 1.15, "testing", "one check\na kind", "contract")
    arrow(axes, (10.3, 2.92), (10.3, 3.88))
    arrow(axes, (9.68, 2.3), (9.3, 2.3))
    box(axes, 0.1, 1.75, 1.5, 1.15, "hooks", "one a kind", "contract")
    box(axes, 1.8, 1.75, 2.6, 1.15, "cameras   image", "rays of pixels;\nviews, panoramas, JPEG", "contract")
    box(axes, 4.6, 1.75, 2.9, 1.15, "posegraph   trajectory", "graphs, files; errors, files", "contract")
    box(axes, 7.7, 1.75, 1.6, 1.15, "metrics", "of localisation", "contract")
    box(
        axes,
        0.1,
        0.15,
        6.2,
        0.95,
        "api",
        "data, poses, records, results; kinds: a Protocol each, and the table KINDS",
        "base",
    )
    box(axes, 6.5, 0.15, 2.8, 0.95, "geometry   errors", "numpy, the standard library", "base")
    for x in (0.85, 3.1, 5.6, 7.3, 8.5):
        arrow(axes, (x, 1.73), (x, 1.12))
    axes.text(
        9.45, 0.62, "green and grey: the contract,\nall that plugins may import", size=8.5, va="center", color=INK
    )
    return figure


if __name__ == "__main__":
    draw().savefig(Path(__file__).with_name("architecture.png"))
