"""The figures of a sweep, as PNG files."""

from __future__ import annotations

import io
import itertools
import os
import re
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omnilab.api import Floats
from omnilab.atomic_files import write_whole
from omnilab.errors import DataError
from omnilab.file_kinds import content_of
from omnilab.runner.compare import plots
from omnilab.runner.compare.comparison import OVER_SEEDS, RunComparison
from omnilab.runner.compare.order import sorted_groups
from omnilab.runner.run_folder import load_run

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SOFTWARE = "omnilab compare"  # by which a PNG is known as one of ours
LARGEST = 64 * 2**20  # bytes of a PNG
MOST_PANELS = 6
WALL = "wall time of a run, on its machine [s]"


def draw(comparison: RunComparison, metrics: Sequence[str], folder: Path, objective: str | None = None) -> list[Path]:
    """Write all figures of these metrics into a folder: their files.

    `objective`: METRIC, or "-METRIC" where more is better, whose Pareto front is drawn. DataError if a file of that name
    is none of ours, or nothing differs.
    """
    if not comparison.settings:
        raise DataError(
            "nothing differs between these runs but the seed, so there is nothing to draw; give a sweep over settings"
        )
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for metric in metrics:
        for name, figure in _figures(comparison, metric, _sign(metric, objective)):
            file = folder / f"{re.sub(r'[^A-Za-z0-9_.-]+', '_', name)}.png"
            _save(figure, file)
            written.append(file)
    return written


def _sign(metric: str, objective: str | None) -> int:
    return {metric: 1, f"-{metric}": -1}.get(objective or "", 0)


def _figures(comparison: RunComparison, metric: str, sign: int) -> Iterator[tuple[str, Figure]]:
    """All figures of a metric, by name."""
    label = _label(comparison, metric)
    settings = comparison.settings
    for setting in settings:
        yield f"{metric}_by_{setting}", plots.curves(setting, label, _lines(comparison, metric, setting))
    for across, down in itertools.combinations(settings, 2):
        panels = _panels(comparison, metric, across, down)
        if len(panels) <= MOST_PANELS:
            yield f"{metric}_by_{across}_and_{down}", plots.heat_maps(across, down, label, panels)
    means = comparison.wide("mean")[metric].to_numpy(float)
    if len(settings) > 2 and np.isfinite(means).any():
        columns = {setting: comparison.groups[setting].tolist() for setting in settings}
        yield f"{metric}_parallel", plots.parallel_coordinates(columns, label, means)
    cost = _wall_s(comparison)
    known = np.isfinite(cost) & np.isfinite(means)
    if known.any():
        labels = [_settings(comparison, group, settings) for group in comparison.groups.index[known]]
        yield f"{metric}_by_cost", plots.pareto(WALL, label, (cost[known], means[known]), labels, sign)


def _label(comparison: RunComparison, metric: str) -> str:
    unit = str(comparison.statistics.xs(metric, level="metric")["unit"].iloc[0])
    return f"{metric} [{unit}]" if unit else metric


def _lines(comparison: RunComparison, metric: str, setting: str) -> list[plots.MetricCurve]:
    """A line for each combination of the other settings."""
    table = comparison.statistics.xs(metric, level="metric")
    others = [name for name in comparison.settings if name != setting]
    found: dict[str, list[int]] = {}
    for group in sorted_groups(comparison.groups, [*others, setting]):
        found.setdefault(_settings(comparison, group, others), []).append(group)
    lines = []
    for label, groups in found.items():
        rows = table.reindex(groups)
        value, low, high = (rows[column].to_numpy(float) for column in ("mean", "low", "high"))
        over_seeds = (rows["interval"] == OVER_SEEDS).to_numpy(bool)
        lines.append(
            plots.MetricCurve(label, comparison.groups.loc[groups, setting].tolist(), value, low, high, over_seeds)
        )
    return lines


def _panels(comparison: RunComparison, metric: str, across: str, down: str) -> dict[str, dict[tuple[str, str], float]]:
    """The means over two settings, for each combination of the others."""
    others = [name for name in comparison.settings if name not in {across, down}]
    means = comparison.wide("mean")[metric]
    panels: dict[str, dict[tuple[str, str], float]] = {}
    for group in sorted_groups(comparison.groups, others):
        row = comparison.groups.loc[group]
        panels.setdefault(_settings(comparison, group, others), {})[row[across], row[down]] = float(means[group])
    return panels


def _settings(comparison: RunComparison, group: int, names: Sequence[str]) -> str:
    """Settings of a configuration in a line, by the last words of their names where these are clear."""
    last = [name.rpartition(".")[2] for name in comparison.settings]
    short = {
        name: word if last.count(word) == 1 else name for name, word in zip(comparison.settings, last, strict=True)
    }
    values = comparison.groups.loc[group]
    return ", ".join(f"{short[name]}={values[name]}" for name in names if values[name] is not None)


def _wall_s(comparison: RunComparison) -> Floats:
    """The mean wall time of each configuration's runs; NaN where none says it."""
    seconds = [_wall_of(folder) for folder in comparison.runs["folder"]]
    means = comparison.runs.assign(wall_s=seconds).groupby("group")["wall_s"].mean()
    return np.asarray(means.reindex(comparison.groups.index).to_numpy(float))


def _wall_of(folder: Path) -> float:
    """The wall time that a run's cost.csv says; NaN if it says none."""
    try:
        rows = load_run(folder).table("cost")
        return next((float(row["value"]) for row in rows if row["cost"] == "wall"), np.nan)
    except (DataError, KeyError, ValueError):
        return np.nan


def _save(figure: Figure, file: Path) -> None:
    """Write a PNG; DataError if there is a file of this name that is no figure of ours."""
    if os.path.lexists(file) and not _is_ours(file):
        raise DataError(f"{file} is there already, and none of our figures; give another folder (--figures DIR)")
    picture = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # then a box stands for it
        figure.savefig(picture, format="png", metadata={"Software": SOFTWARE})
    write_whole(file, lambda out: out.write(picture.getbuffer()))


def _is_ours(file: Path) -> bool:
    """Whether a file is a PNG that was drawn here; False for links, pipes and what cannot be read."""
    try:
        return not file.is_symlink() and SOFTWARE.encode() in content_of(file, LARGEST)[:4096]
    except OSError:
        return False
