"""Results of localisation along a route: errors of every method by every localizer, and sets of places."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from omnilab.api import Floats, Metric
from omnilab.geometry import wrap_angle
from omnilab.metrics import bootstrap
from omnilab_studies.common.methods import key_of
from omnilab_studies.common.samples import of_known
from omnilab_studies.localization.route_localization.ambiguity import PlaceSets
from omnilab_studies.localization.route_localization.drives import RouteDrive
from omnilab_studies.localization.route_localization.route import along_across

STATISTICS = {"median": 0.5, "p90": 0.9, "worst": 1.0}


@dataclass(frozen=True)
class RouteErrors:
    """Errors of one method by one localizer for Q queries; NaN where the truth is not known."""

    method: str
    localizer: str
    answer_m: Floats  # (Q, 3)
    error_m: Floats  # (Q,)
    along_m: Floats  # (Q,) ahead of the truth
    across_m: Floats  # (Q,) to its left
    heading_deg: Floats  # (Q,) answered heading - true heading

    @property
    def key(self) -> str:
        """Its part of the names of metrics."""
        return f"{key_of(self.method)}_{self.localizer}"

    @property
    def median_m(self) -> float:
        """Median error."""
        return of_known(np.median, self.error_m)

    def spreads(self) -> Iterator[tuple[str, str, Floats]]:
        """Name, unit and absolute values of each kind of error."""
        yield "position_error", "m", self.error_m
        yield "along_error", "m", np.abs(self.along_m)
        yield "across_error", "m", np.abs(self.across_m)
        if np.isfinite(self.heading_deg).any():
            yield "heading_error", "deg", np.abs(self.heading_deg)


@dataclass(frozen=True)
class Compass:
    """HeadingReference by images alone along a drive of N images, beside the known ones: the visual compass."""

    method: str
    heading: Floats  # (N,) radians: rotations between consecutive images, summed up, the mean deviation taken off
    deviation_deg: Floats  # (N,) from the known heading; NaN where that is not known


def route_errors(
    method: str, localizer: str, answer_m: Floats, heading: Floats | None, queries: RouteDrive, route_course: Floats
) -> RouteErrors:
    """Answers (Q, 3) and headings (Q,) beside the truth; `route_course` (Q,) is the route's where each query was taken."""
    error = answer_m - queries.position_m
    along_m, across_m = along_across(error, route_course)
    off = np.full(len(queries), np.nan) if heading is None else np.rad2deg(wrap_angle(heading - queries.heading))
    return RouteErrors(method, localizer, answer_m, np.linalg.norm(error, axis=1), along_m, across_m, off)


def compass(method: str, turns: Floats, known: Floats) -> Compass:
    """The visual compass of N images from the rotations (N - 1,) between them; `known` (N,) are the known headings."""
    heading = np.append(0.0, np.cumsum(turns))
    off = heading - known
    mean = np.angle(np.nanmean(np.exp(1j * off))) if np.isfinite(off).any() else 0.0
    return Compass(method, heading - mean, np.rad2deg(wrap_angle(off - mean)))


def metrics_of(
    errors: Sequence[RouteErrors], sets: Mapping[str, PlaceSets], held: Mapping[str, Floats],
    compasses: Sequence[Compass], rng: np.random.Generator,
) -> list[Metric]:  # fmt: skip
    """Errors of every method by every localizer, sets of places and compass of every method.

    `held` are 1 where a set holds the truth, 0 where not, NaN where that is not known or was used to calibrate.
    """
    found = []
    for own in errors:
        for name, unit, values in own.spreads():
            statistic = partial(_median_of, values)
            interval = bootstrap(statistic, len(values), rng, 200) if name == "position_error" else None
            found += [
                Metric(f"{own.key}_{name}_{which}", _quantile(values, share), unit, interval if share == 0.5 else None)
                for which, share in STATISTICS.items()
            ]
    for method, own_sets in sets.items():
        key = key_of(method)
        found += [
            Metric(f"{key}_set_coverage", of_known(np.mean, held[method]), "1", note="no query was left to test it"),
            Metric(f"{key}_set_size_median", float(np.median(own_sets.size)), "places"),
            Metric(f"{key}_set_extent_median", float(np.median(own_sets.extent_m)), "m"),
            Metric(f"{key}_ambiguous_rate", float(own_sets.ambiguous.mean()), "1"),
        ]
    for each in compasses:
        found += [
            Metric(
                f"{key_of(each.method)}_compass_error_{which}",
                _quantile(np.abs(each.deviation_deg), share),
                "deg",
                note="no heading of the drive is known",
            )
            for which, share in STATISTICS.items()
        ]
    return found


def error_rows(
    errors: Sequence[RouteErrors], sets: Mapping[str, PlaceSets], held: Mapping[str, Floats]
) -> list[dict[str, Any]]:
    """A row for each method by each localizer."""
    return [
        {
            "method": own.method, "localizer": own.localizer, "queries": int(np.isfinite(own.error_m).sum()),
            **{f"{name}_{which}_{unit}": _quantile(values, share) for name, unit, values in _all_spreads(own)
               for which, share in STATISTICS.items()},
            "set_coverage": of_known(np.mean, held[own.method]), "set_size_median": float(np.median(sets[own.method].size)),
            "set_extent_median_m": float(np.median(sets[own.method].extent_m)),
            "ambiguous_rate": float(sets[own.method].ambiguous.mean()),
        }
        for own in errors
    ]  # fmt: skip


def query_rows(
    errors: Sequence[RouteErrors], sets: Mapping[str, PlaceSets], queries: RouteDrive
) -> list[dict[str, Any]]:
    """A row for each query of each method by each localizer."""
    return [
        {
            "query": i, "key": key, "method": own.method, "localizer": own.localizer,
            **{f"truth_{axis}_m": float(queries.position_m[i, n]) for n, axis in enumerate("xy")},
            **{f"answer_{axis}_m": float(own.answer_m[i, n]) for n, axis in enumerate("xy")},
            "error_m": float(own.error_m[i]), "along_m": float(own.along_m[i]), "across_m": float(own.across_m[i]),
            "heading_error_deg": float(own.heading_deg[i]), "set_size": int(sets[own.method].size[i]),
            "ambiguous": bool(sets[own.method].ambiguous[i]),
        }
        for own in errors for i, key in enumerate(queries.keys)
    ]  # fmt: skip


def _all_spreads(own: RouteErrors) -> Iterator[tuple[str, str, Floats]]:
    """Those of `spreads`, and headings also where there are none."""
    found = {name: (name, unit, values) for name, unit, values in own.spreads()}
    yield from (found | {"heading_error": ("heading_error", "deg", np.abs(own.heading_deg))}).values()


def _quantile(values: Floats, share: float) -> float:
    return of_known(partial(_at_share, share), values)


def _at_share(share: float, values: Floats) -> float:
    return float(np.quantile(values, share))


def _median_of(values: Floats, chosen: Any) -> float:
    return of_known(np.median, values[chosen])
