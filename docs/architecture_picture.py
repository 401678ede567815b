"""Draws docs/architecture.png, which way imports point: uv run python docs/architecture_picture.py"""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

INK, LINE = "#1f2a37", "#5b6b7f"
COLORS = {"plugin": "#dcebfa", "runner": "#fbe5d6", "contract": "#dff2e1", "base": "#eef0f3"}

PLUGINS = {
    "appearance": "descriptors\n... odometries",
    "studies": "by family",
    "mirror": "virtual\nsensors",
    "recordings": "image folders",
    "slam": "GTSAM",
    "rerun": "sink, view",
    "mcap": "sink",
}
RUNNER = "command line, Hydra, build,\nexecute, run folder, cache"
CONTRACT = (  # left edge, width, title, text
    (0.1, 1.5, "hooks", "one a kind"),
    (1.8, 2.6, "cameras   image", "rays of pixels;\nviews, panoramas, JPEG"),
    (4.6, 2.9, "posegraph   trajectory", "graphs, files; errors, files"),
    (7.7, 1.6, "metrics", "of localisation"),
)
BASE = (
    (0.1, 6.2, "api", "data, poses, records, results; kinds: a Protocol each, and the table KINDS"),
    (6.5, 2.8, "geometry   errors", "numpy, the standard library"),
)


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
    """Plugins and the runner above the contract, `api` below all of it."""
    figure = Figure(figsize=(11, 5.6), dpi=130, layout="constrained")
    axes = figure.subplots()
    axes.set(xlim=(0, 11), ylim=(0, 5.7), aspect="equal")
    axes.set_axis_off()
    draw_plugins(axes)
    draw_runner(axes)
    draw_contract(axes)
    return figure


def draw_plugins(axes: Axes) -> None:
    note(axes, 0.1, 5.3, "plugins: a distribution each; none imports another, none imports the runner", 9.5)
    for i, (name, text) in enumerate(PLUGINS.items()):
        x = 0.1 + 1.07 * i
        box(axes, x, 3.9, 0.97, 1.15, name, text, "plugin")
        arrow(axes, (x + 0.485, 3.88), (x + 0.485, 2.92))


def draw_runner(axes: Axes) -> None:
    """The runner, what it finds and imports, and the checks, which import it."""
    note(axes, 8.3, 5.3, "omnilab, the command", 9.5)
    box(axes, 8.3, 3.9, 2.6, 1.15, "omnilab.runner", RUNNER, "runner")
    arrow(axes, (8.28, 4.47), (7.55, 4.47), "--")
    axes.text(7.93, 4.6, "finds", ha="center", size=8.5, color=LINE)
    arrow(axes, (9.0, 3.88), (9.0, 2.92))
    box(axes, 9.7, 1.75, 1.2, 1.15, "testing", "one check\na kind", "contract")
    arrow(axes, (10.3, 2.92), (10.3, 3.88))
    arrow(axes, (9.68, 2.3), (9.3, 2.3))


def draw_contract(axes: Axes) -> None:
    for x, width, title, text in CONTRACT:
        box(axes, x, 1.75, width, 1.15, title, text, "contract")
    for x, width, title, text in BASE:
        box(axes, x, 0.15, width, 0.95, title, text, "base")
    for x in (0.85, 3.1, 5.6, 7.3, 8.5):
        arrow(axes, (x, 1.73), (x, 1.12))
    note(axes, 9.45, 0.62, "green and grey: the contract,\nall that plugins may import", 8.5)


def note(axes: Axes, x: float, y: float, text: str, size: float) -> None:
    """Words without a box, from the left end of their base line; of two lines, from their middle."""
    axes.text(x, y, text, size=size, color=INK, va="center" if "\n" in text else "baseline")


if __name__ == "__main__":
    draw().savefig(Path(__file__).with_name("architecture.png"))
