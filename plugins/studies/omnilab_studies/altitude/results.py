"""Results of the study `altitude`: height estimates beside the truth, scores, tables, metrics."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Floats, Heights, Metric
from omnilab_studies.common.disturbance_levels import Level
from omnilab_studies.common.tables import columns_of

LEAST_M = 0.1  # rises whose sign counts
ROUNDING_M = 1e-6
FEWEST = 3  # points that a line is fitted to
NO_SPREAD = "no height was estimated but 0"


class AltitudeCase(NamedTuple):
    """An altimeter at one level of disturbance against one reference."""

    altimeter: str
    level: str
    reference: str


@dataclass(frozen=True)
class HeightEstimates:
    """An altimeter's estimates of one column: n tests against one reference."""

    column: int
    height_m: Floats  # (n,) of the tests
    rise_m: Floats  # (n,) over the reference
    heights: Heights
    rotation_error_rad: Floats  # (n,)

    @property
    def value(self) -> Floats:
        """The estimates (n,) in the altimeter's unit, NaN where there is none."""
        return self.heights.value

    @property
    def relative(self) -> Floats:
        """The estimates (n,) divided by the largest of the column (thesis, figures 5.17-5.20); NaN where all are 0."""
        largest = float(np.nanmax(np.abs(self.value), initial=0.0))
        return self.value / largest if largest > 0 else np.full_like(self.value, np.nan, dtype=float)

    def line(self, range_m: float) -> tuple[float, float] | None:
        """Slope and r2 of a line fitted to the values within `range_m` of the reference; None with too few points."""
        near = (np.abs(self.rise_m) <= range_m + ROUNDING_M) & np.isfinite(self.value)
        if near.sum() < FEWEST or np.ptp(self.rise_m[near]) < ROUNDING_M:
            return None
        x, y = self.rise_m[near], self.value[near]
        slope, _ = np.polyfit(x, y, 1)
        return float(slope), 0.0 if np.ptp(y) == 0 else float(np.corrcoef(x, y)[0, 1] ** 2)


@dataclass
class AltitudeResults:
    """All estimates, case by case."""

    levels: Sequence[Level]
    references: Sequence[str]
    range_m: float  # around the reference: where lines are fitted
    by_case: dict[AltitudeCase, list[HeightEstimates]] = field(default_factory=dict)

    @property
    def altimeters(self) -> list[str]:
        """The names of the altimeters."""
        return list(dict.fromkeys(case.altimeter for case in self.by_case))

    def add(self, case: AltitudeCase, estimates: HeightEstimates) -> None:
        """Add the estimates of one column."""
        self.by_case.setdefault(case, []).append(estimates)

    def of(self, altimeter: str, level: str | None = None, reference: str | None = None) -> list[HeightEstimates]:
        """The estimates of one altimeter, at one level and against one reference, or at and against all."""
        return [
            estimates
            for case, parts in self.by_case.items()
            if case.altimeter == altimeter and level in (None, case.level) and reference in (None, case.reference)
            for estimates in parts
        ]

    def scale(self, altimeter: str, reference: str) -> float:
        """Metres per unit, for all columns: least squares through 0 over the clear estimates. NaN if all are 0."""
        parts = self.of(altimeter, self.levels[0].title, reference)
        value, rise = _joined(parts, "value"), _joined(parts, "rise_m")
        known = np.isfinite(value)
        power = float((value[known] ** 2).sum())
        return float((value[known] * rise[known]).sum()) / power if power > 0 else float("nan")

    def scores(self) -> list[dict[str, Any]]:
        """The table `altitude`: one row a case."""
        return [self._score(case, parts) for case, parts in self.by_case.items()]

    def _score(self, case: AltitudeCase, parts: Sequence[HeightEstimates]) -> dict[str, Any]:
        lines = [line for estimates in parts if (line := estimates.line(self.range_m)) is not None]
        slopes, r2 = np.array(lines or [(np.nan, np.nan)]).T
        value, rise = _joined(parts, "value"), _joined(parts, "rise_m")
        known = np.isfinite(value)
        error = self.scale(case.altimeter, case.reference) * value[known] - rise[known]
        near = np.abs(rise[known]) <= self.range_m + ROUNDING_M
        return {
            **case._asdict(),
            "pairs": len(value),
            "unanswered": int((~known).sum()),
            "sign_rate": sign_rate(value, rise),
            "slope_mean": float(slopes.mean()),
            "slope_std": float(slopes.std()),
            "unit": parts[0].heights.unit,
            "r2_median": float(np.median(r2)),
            "r2_lowest": float(r2.min()),
            "rms_m": _rms(error),
            "rms_near_m": _rms(error[near]),
            "bias_m": float(error.mean()) if error.size else float("nan"),
            "spread": spread_of(parts),
            "rotation_error_median_deg": float(np.rad2deg(np.median(_joined(parts, "rotation_error_rad")))),
        }

    def sign_table(self) -> dict[str, list[Any]]:
        """The table `signs`, rates of right signs by the size of the rise: one row for each altimeter, level and size."""
        rows = []
        for altimeter in self.altimeters:
            for level in self.levels:
                value, rise = (_joined(self.of(altimeter, level.title), name) for name in ("value", "rise_m"))
                for size in np.unique(np.abs(rise).round(3)):
                    at = np.abs(np.abs(rise) - size) < 1e-3
                    if size >= ROUNDING_M:
                        rows.append(
                            (altimeter, level.title, float(size), int(at.sum()), sign_rate(value[at], rise[at], 0))
                        )
        names = ("altimeter", "level", "rise_m", "pairs", "sign_rate")
        return dict(zip(names, map(list, zip(*rows, strict=True)), strict=True))

    def estimate_table(self) -> dict[str, list[Any]]:
        """The table `estimates`: one row an estimate."""
        return columns_of(list(self._estimate_rows()))

    def _estimate_rows(self) -> Iterator[dict[str, Any]]:
        for case, parts in self.by_case.items():
            for estimates in parts:
                for i, height in enumerate(estimates.height_m):
                    yield {
                        **case._asdict(),
                        "column": estimates.column,
                        "height_m": round(float(height), 6),
                        "rise_m": round(float(estimates.rise_m[i]), 6),
                        "value": float(estimates.value[i]),
                        "confidence": float(estimates.heights.confidence[i]),
                        "rotation_error_deg": float(np.rad2deg(estimates.rotation_error_rad[i])),
                    }

    def metrics(self) -> list[Metric]:
        """Rates of right signs of clear images first, then each case's scores."""
        clear = self.levels[0].title
        first, rest = [], []
        for name in self.altimeters:
            parts = self.of(name, clear)
            rate = sign_rate(_joined(parts, "value"), _joined(parts, "rise_m"))
            first.append(Metric(f"{name}_sign_clear", rate, "1", note="no image is 0.1 m or more from a reference"))
        for row in self.scores():
            key = f"{row['altimeter']}_{{}}_{_key(row['level'])}_{_key(row['reference'])}"
            kinds = {"sign_rate": "1", "r2_median": "1", "rms_m": "m", "rms_near_m": "m", "bias_m": "m", "spread": "1"}
            rest += [
                Metric(key.format(kind), row[kind], unit, note=NO_SPREAD)
                for kind, unit in kinds.items()
                if np.isfinite(row[kind]) or kind == "spread"
            ]
            if np.isfinite(row["slope_mean"]):
                rest.append(Metric(key.format("slope"), row["slope_mean"], f"{row['unit']}/m"))
        return first + rest


def sign_rate(value: Floats, rise_m: Floats, least_m: float = LEAST_M) -> float:
    """The share of the rises of at least `least_m` whose values have their sign. No estimate and 0 are wrong."""
    far = np.abs(rise_m) >= least_m - ROUNDING_M
    return float(np.mean(np.sign(value[far]) == np.sign(rise_m[far]))) if far.any() else float("nan")


def by_height(parts: Sequence[HeightEstimates]) -> tuple[Floats, Floats, Floats]:
    """Heights (n,), and mean and standard deviation over the columns of the estimates there, relative to their column's largest."""
    heights, relative = (np.concatenate([getattr(part, name) for part in parts]) for name in ("height_m", "relative"))
    known = np.isfinite(relative)
    heights, relative = heights[known].round(2), relative[known]
    at = np.unique(heights)
    groups = [relative[heights == height] for height in at]
    return at, np.array([group.mean() for group in groups]), np.array([group.std() for group in groups])


def spread_of(parts: Sequence[HeightEstimates]) -> float:
    """The mean over the heights of the standard deviation over the columns; NaN without estimates."""
    deviation = by_height(parts)[2]
    return float(deviation.mean()) if len(deviation) else float("nan")


def _joined(parts: Sequence[HeightEstimates], name: str) -> Floats:
    return np.concatenate([getattr(part, name) for part in parts]) if parts else np.empty(0)


def _rms(error: Floats) -> float:
    return float(np.sqrt(np.mean(error**2))) if error.size else float("nan")


def _key(title: str) -> str:
    """A title as a part of a metric's name."""
    return title.replace(" ", "_")


def markdown_of(rows: Sequence[Mapping[str, Any]]) -> str:
    """Scores as a document for the viewer."""
    shown = ("altimeter", "level", "reference", "sign_rate", "r2_median", "rms_near_m", "bias_m", "spread")
    lines = ["## Relative altitude", "", f"| {' | '.join(name.replace('_', ' ') for name in shown)} |"]
    lines.append("|---" * len(shown) + "|")
    for row in rows:
        cells = [f"{row[name]:.3f}" if isinstance(row[name], float) else str(row[name]) for name in shown]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)
