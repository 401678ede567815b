"""What curves are called, and their colours: told apart in their plot, the same in every run of a study."""

from __future__ import annotations

from typing import Any

from omnilab.api import Series
from omnilab_rerun.colors import RUNS, TRUTH, Color

Style = dict[str, Any]


class Curves:
    """The styles of the curves that were logged so far."""

    def __init__(self) -> None:
        self._styles: dict[str, Style] = {}

    def new_style(self, path: str, series: Series, top: tuple[float, float] | None) -> Style | None:
        """Name and colour of a curve; None if they have not changed. `top`: see `RecordsSeen.top`."""
        before = self._styles.get(path)
        color = before["colors"] if before else [series.color or self._free_color(path)]
        style = {"names": _name(path, series.unit, top), "colors": color}
        self._styles[path] = style
        return style if style != before else None

    def _free_color(self, path: str) -> Color:
        """One that no other curve beside it has, as long as there are any; the truth is white."""
        parent, _, name = path.rpartition("/")
        if name == "truth":
            return TRUTH
        taken = [style["colors"][0] for other, style in self._styles.items() if other.rpartition("/")[0] == parent]
        return min(RUNS.values(), key=taken.count)


def _name(path: str, unit: str, top: tuple[float, float] | None) -> str:
    """The last part of the path, with what leaves the plot, and the unit."""
    name = path.rpartition("/")[2]
    beyond = f", up to {top[1]:{'.0f' if top[1] >= 1000 else '.3g'}}" if top else ""
    return f"{name}{beyond} [{unit}]" if unit != "1" else name
