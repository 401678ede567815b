"""SeedEstimates over seeds, what is expected of them, and the verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from omnilab.runner.fidelity.measured import MeasuredValue

REACHED, BY_VARIANT = "reached", "reached by the variant"
NOT_REACHED, OTHER_ORDER = "not reached", "other order"
NOT_MEASURED, NOT_TESTED = "not measured", "cannot be tested"
VERDICTS = (REACHED, BY_VARIANT, NOT_REACHED, OTHER_ORDER, NOT_MEASURED, NOT_TESTED)
CONFIDENCE = 0.95
FALLING, RISING = "falling", "rising"


@dataclass(frozen=True)
class SeedEstimate:
    """A value over the runs of some seeds."""

    value: float
    seeds: int
    low: float | None = None
    high: float | None = None
    unit: str = ""


@dataclass(frozen=True)
class Expectation:
    """When a claim holds: about a value, at least or at most one, or an order of named values."""

    about: float | None = None
    within: float = 0.0
    at_least: float | None = None
    at_most: float | None = None
    order: str = ""  # of the values as they are listed: FALLING or RISING

    @classmethod
    def parsed(cls, content: Any) -> Expectation:
        """Of {about, within}, {at_least}, {at_most}, both of these, or {order}; ValueError or TypeError otherwise."""
        if not isinstance(content, dict):
            raise TypeError("`expect` should be a mapping")
        keys = set(content)
        if keys == {"order"} and content["order"] in (FALLING, RISING):
            return cls(order=content["order"])
        numbers: dict[str, Any] = {str(key): float(value) for key, value in content.items()}
        if keys in ({"about", "within"}, {"at_least"}, {"at_most"}, {"at_least", "at_most"}):
            return cls(**numbers)
        raise ValueError(
            "`expect` has about with within, at_least, at_most, or an order that is falling or rising;"
            f" not {', '.join(sorted(keys))}"
        )

    @property
    def limits(self) -> tuple[float, float]:
        """The least and the greatest value with which the claim holds."""
        if self.about is not None:
            return self.about - self.within, self.about + self.within
        low, high = self.at_least, self.at_most
        return -math.inf if low is None else low, math.inf if high is None else high

    @property
    def words(self) -> str:
        """As in the table."""
        if self.order:
            return f"{self.order}, in this order"
        if self.about is not None:
            return f"{self.about:g} ± {self.within:g}"
        words = [f"at least {self.at_least:g}"] if self.at_least is not None else []
        words += [f"at most {self.at_most:g}"] if self.at_most is not None else []
        return ", ".join(words)

    def holds(self, estimates: Sequence[SeedEstimate]) -> bool:
        """Whether estimates, in the order in which they are listed, are as expected. NaN never is."""
        values = [estimate.value for estimate in estimates]
        if self.order:
            falling = values if self.order == FALLING else values[::-1]
            return all(first > second for first, second in pairwise(falling))
        low, high = self.limits
        return all(low <= value <= high for value in values)

    def open(self, estimates: Sequence[SeedEstimate]) -> bool:
        """Whether values within the intervals of estimates are as expected, and others are not."""
        bounds = [(e.value if e.low is None else e.low, e.value if e.high is None else e.high) for e in estimates]
        if self.order:
            falling = bounds if self.order == FALLING else bounds[::-1]
            return _can_fall(falling) and any(first[0] <= second[1] for first, second in pairwise(falling))
        least, most = self.limits
        inside = all(low <= most and high >= least for low, high in bounds)
        return inside and any(low < least or high > most for low, high in bounds)


def _can_fall(bounds: Sequence[tuple[float, float]]) -> bool:
    """Whether there is a falling sequence of values within bounds."""
    last = math.inf
    for low, high in bounds:
        if low >= last:
            return False
        last = min(last, high)
    return True


SeedEstimates = Mapping[str, SeedEstimate] | None  # None: something of it was not measured


def verdict(expect: Expectation | None, protocol: SeedEstimates, variant: SeedEstimates) -> str:
    """The verdict on a claim that can be tested."""
    if expect is None:
        return NOT_TESTED
    if protocol is not None and expect.holds(list(protocol.values())):
        return REACHED
    if variant is not None and expect.holds(list(variant.values())):
        return BY_VARIANT
    if protocol is None:
        return NOT_MEASURED
    return OTHER_ORDER if expect.order else NOT_REACHED


def is_open(expect: Expectation | None, protocol: SeedEstimates, variant: SeedEstimates) -> bool:
    """Whether the values that a verdict is about could be otherwise within their intervals."""
    deciding = variant if verdict(expect, protocol, variant) == BY_VARIANT else protocol
    return expect is not None and deciding is not None and expect.open(list(deciding.values()))


def estimate(values: Sequence[MeasuredValue]) -> SeedEstimate:
    """The mean over seeds, with Student's interval of 95 %; of a single run, its value and its own interval, if any."""
    numbers, count, unit = [value.value for value in values], len(values), values[0].unit
    mean = math.fsum(numbers) / count
    if count == 1:
        return SeedEstimate(mean, 1, values[0].low, values[0].high, unit)
    from scipy.special import stdtrit

    spread = math.sqrt(math.fsum((number - mean) ** 2 for number in numbers) / (count - 1) / count)
    half = float(stdtrit(count - 1, (1 + CONFIDENCE) / 2)) * spread
    return SeedEstimate(mean, count, mean - half, mean + half, unit)
