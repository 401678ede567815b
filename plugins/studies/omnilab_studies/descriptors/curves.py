"""Straight lines on a grid, and the curve of image distance over metric distance along them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Floats, Ints
from omnilab.errors import DataError

ON_NODE = 0.1  # steps that a place may lie off the grid


@dataclass(frozen=True)
class Curve:
    """An image distance over n metric distances, mean and variance over A lines, and the line through the origin.

    `slope` is that of the least squares through (0, 0). Both r2 are of that line: 1 - residuals / deviations, with the
    deviations from the mean (`r2_centred`) or from 0 (`r2_origin`, always the higher). The point (0, 0) itself does
    not count.
    """

    distance_m: Floats  # (n,)
    mean: Floats  # (n,)
    variance: Floats  # (n,)

    @property
    def relative(self) -> Floats:
        """The mean, its highest value being 1."""
        return self.mean / self._highest

    @property
    def relative_deviation(self) -> Floats:
        """Standard deviation over the lines, in the unit of `relative`."""
        return np.sqrt(self.variance) / self._highest

    @property
    def _highest(self) -> float:
        """Value of the mean; 1 where all are 0, as distances of equal images are."""
        return float(self.mean.max()) or 1.0

    @property
    def spread(self) -> float:
        """Standard deviation over the lines, relative to the mean; averaged over the metric distances."""
        deviation = np.sqrt(self.variance)
        return float(np.mean(np.divide(deviation, self.mean, out=np.zeros_like(self.mean), where=self.mean > 0)))

    @property
    def slope(self) -> float:
        """Image distance per metre, of the least squares line through (0, 0)."""
        return float(self.distance_m @ self.mean / (self.distance_m @ self.distance_m))

    @property
    def r2_centred(self) -> float:
        """r2 against deviations from the mean."""
        return self._explained(float(self.mean.mean()))

    @property
    def r2_origin(self) -> float:
        """r2 against deviations from 0."""
        return self._explained(0.0)

    @property
    def monotone_m(self) -> float:
        """Metres from the reference up to which the mean rises with every step."""
        rises = np.diff(self.mean, prepend=0.0) > 0
        count = len(rises) if rises.all() else int(rises.argmin())
        return float(self.distance_m[count - 1]) if count else 0.0

    def _explained(self, level: float) -> float:
        """r2 against deviations from a level; 0 for a curve that stays on the level."""
        deviations = float(np.sum((self.mean - level) ** 2))
        residuals = float(np.sum((self.mean - self.slope * self.distance_m) ** 2))
        return 1 - residuals / deviations if deviations > 0 else 0.0


def lines_on_grid(position_m: Floats, step_m: float, reach_m: float, references: int, rng: np.random.Generator) -> Ints:
    """Lines (A, n + 1) along the rows and columns of a grid: indices into its nodes (P, 3), the reference first.

    References are drawn until so many have lines; each has one to four. A line is whole or left out: all its nodes up to
    `reach_m` are there, so that every metric distance is an average over the same lines.
    """
    cells = (position_m[:, :2] - position_m[0, :2]) / step_m
    whole = np.round(cells).astype(int)
    node_at = {(int(x), int(y)): i for i, (x, y) in enumerate(whole) if np.abs(cells[i] - whole[i]).max() < ON_NODE}
    count = round(reach_m / step_m)
    found: list[list[list[int]]] = []
    for reference in rng.permutation(len(position_m)):
        if lines := _lines_from(int(reference), whole, node_at, count):
            found.append(lines)
        if len(found) == references:
            break
    if not found:
        raise DataError(
            f"none of the {len(position_m)} places has a line of {count} more places {step_m:g} m apart; give a"
            " study.step_m that is the grid's, or a smaller study.reach_m"
        )
    return np.array([line for lines in found for line in lines])


def _lines_from(reference: int, cells: Ints, node_at: dict[tuple[int, int], int], count: int) -> list[list[int]]:
    """The whole lines of `count` + 1 nodes from a reference, in up to four directions."""
    x, y = (int(value) for value in cells[reference])
    lines = [
        [node_at.get((x + k * along, y + k * across), -1) for k in range(count + 1)]
        for along, across in ((1, 0), (0, 1), (-1, 0), (0, -1))
    ]
    return [line for line in lines if line[0] == reference and min(line) >= 0]


def whole_lines(lines: Ints, delivered: Ints) -> Ints:
    """The lines all of whose images were delivered, as indices into those."""
    whole = lines[np.isin(lines, delivered).all(axis=1)]
    if len(whole) == 0:
        raise DataError(
            "every line misses an image that could not be read; mend the recording, or give more study.references"
        )
    return np.searchsorted(delivered, whole)
