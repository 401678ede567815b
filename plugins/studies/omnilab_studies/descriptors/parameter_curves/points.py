"""What was measured of one method at one value of a parameter."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Any, NamedTuple

from omnilab_studies.common.methods import Method
from omnilab_studies.descriptors.parameter_curves.measures import LineCurve, Measured

UNITS = {  # of all that is measured
    "fit_ms": "ms", "fit_cpu_ms": "ms", "view_ms": "ms", "describe_ms": "ms", "describe_cpu_ms": "ms", "locate_ms": "ms",
    "bytes": "B", "r2": "1", "slope_per_m": "1/m", "monotone": "m",
    "nearest": "1", "position_error": "m", "heading_error": "deg",
}  # fmt: skip
CLOCK = frozenset(name for name in UNITS if name.endswith("_ms"))  # differ from run to run


class Point(NamedTuple):
    """A method at one value of a parameter."""

    parameter: str
    value: float
    method: Method
    found: Mapping[str, Measured]
    line: LineCurve | None

    @staticmethod
    def of_line(line: LineCurve | None) -> dict[str, Measured]:
        """What a distance curve says in numbers; `r2` is the centred one."""
        if line is None:
            return {}
        return {
            "r2": line.r2,
            "slope_per_m": Measured(line.curve.slope),
            "monotone": Measured(line.curve.monotone_m),
        }

    @property
    def values(self) -> dict[str, float]:
        """All numbers, without intervals."""
        return {name: estimate.value for name, estimate in self.found.items()}

    @property
    def named(self) -> dict[str, Any]:
        """The columns that say which point it is."""
        return {"parameter": self.parameter, "value": self.value, "method": self.method.name}

    def row(self, without: Collection[str]) -> dict[str, Any]:
        """A row of a table, of all numbers but some."""
        columns: dict[str, Any] = {**self.named, "descriptor": self.method.descriptor_name}
        columns["distance"] = self.method.distance_name
        for name, estimate in self.found.items():
            if name not in without:
                columns |= {name: estimate.value, f"{name}_low": estimate.low, f"{name}_high": estimate.high}
        return columns

    def line_rows(self) -> Iterator[dict[str, Any]]:
        """Every point of the distance curve."""
        if self.line is None:
            return
        curve = self.line.curve
        columns = (curve.distance_m, curve.mean, curve.variance, self.line.low, self.line.high)
        for row in zip(*(column.tolist() for column in columns), strict=True):
            yield {
                **self.named,
                **dict(zip(("distance_m", "mean", "variance", "mean_low", "mean_high"), row, strict=True)),
            }
