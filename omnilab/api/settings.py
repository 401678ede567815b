"""Ranges of numeric settings: declared where a setting is, checked wherever its value comes from."""

from __future__ import annotations

import math
import typing
from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from omnilab.errors import ConfigError

LARGEST_COUNT = 2**31 - 1  # of a whole number without a limit of its own: libraries count with 32 bits
LARGEST = 1e12  # magnitude of a number without a limit of its own: its square is exact enough, its fourth power finite


@dataclass(frozen=True)
class Range:
    """What a numeric setting may be; every number in it, where it is a list or a dictionary.

    Numbers are finite unless `finite` is False. A list holds `count` numbers where that is given, `fewest` or more where
    not. `whole`, `listed` and `optional` follow from the setting's type.
    """

    above: float | None = None
    at_least: float | None = None
    below: float | None = None
    at_most: float | None = None
    multiple_of: int | None = None
    finite: bool = True
    count: int | None = None
    fewest: int = 0
    whole: bool = False
    listed: bool = False
    optional: bool = False

    def __contains__(self, value: Any) -> bool:
        if _is_nan(value) or (self.finite and _is_infinite(value)) or (self.whole and not _is_whole(value)):
            return False
        lowest, highest = self.limits
        inside = lowest <= value <= highest or (_is_infinite(value) and value in {self.limits[0], self.limits[1]})
        inside &= (self.above is None or value > self.above) and (self.below is None or value < self.below)
        return inside and (self.multiple_of is None or value % self.multiple_of == 0)

    @property
    def limits(self) -> tuple[float, float]:
        """Lowest and highest, those by default included."""
        widest = math.inf if not self.finite else LARGEST_COUNT if self.whole else LARGEST
        return -widest if self.at_least is None else self.at_least, widest if self.at_most is None else self.at_most

    @property
    def interval(self) -> str:
        """The limits that were declared, in words; "" without any."""
        least, most = (None if x is None or math.isinf(x) else _short(x) for x in (self.at_least, self.at_most))
        if least and most:
            return f"from {least} to {most}"
        low = f"above {_short(self.above)}" if self.above is not None else f"{least} or more" if least else ""
        high = f"below {_short(self.below)}" if self.below is not None else f"up to {most}" if most else ""
        return f"{low} and {high}" if low and high else low + high

    @property
    def allowed(self) -> str:
        """The range in a few words, as "a whole number from 1 to 16, or null"."""
        kind = "even " if self.multiple_of == 2 else "whole " if self.whole else "" if self.interval else "finite "
        article = "an" if kind == "even " else "a"
        noun = f"{kind}numbers" if self.listed else f"{article} {kind}number"
        if self.count is not None or self.fewest:
            noun = f"{self.count or f'{self.fewest} or more'} {noun}"
        of = " of" if self.interval[:1] in {*"-0123456789"} else ""
        words = f"{noun}{of} {self.interval}".strip()
        if self.multiple_of not in {None, 2}:
            words += f", a multiple of {self.multiple_of}"
        return f"{words}, or null" if self.optional else words


FINITE = Range(at_least=-math.inf, at_most=math.inf)  # of a setting that declares nothing


def setting(
    default: Any = MISSING,
    *,
    above: float | None = None,
    at_least: float | None = None,
    below: float | None = None,
    at_most: float | None = None,
    multiple_of: int | None = None,
    finite: bool = True,
    count: int | None = None,
    fewest: int = 0,
    writes: bool = False,
) -> Any:
    """A field of a component, with the range of its numbers: `offsets: int = setting(173, at_least=4)`.

    The builder refuses what is out of it, before the component is made; `omnilab plugins NAME` shows it. Lists and
    dictionaries may be given as they are. Without limits numbers are finite, whole ones below 2**31. `writes`: it names
    a file or a folder that is written, which `omnilab repeat` puts into the new run's folder.
    """
    metadata: dict[str, Any] = {"range": Range(above, at_least, below, at_most, multiple_of, finite, count, fewest)}
    if writes:
        metadata["writes"] = True
    if isinstance(default, list | dict):
        return field(default_factory=lambda: deepcopy(default), metadata=metadata)
    return field(default=default, metadata=metadata)


@cache
def ranges_of(cls: type[Any]) -> Mapping[str, Range]:
    """The range of each setting of a dataclass: as declared, or that its numbers, if any, are finite."""
    hints = typing.get_type_hints(cls)
    found: dict[str, Range] = {}
    for each in fields(cls):
        declared: Range = each.metadata.get("range", FINITE)
        types = set(plain_types(hints[each.name]))
        whole = declared is not FINITE and int in types and float not in types
        listed = typing.get_origin(hints[each.name]) in {list, dict} or any(
            typing.get_origin(part) in {list, dict} for part in typing.get_args(hints[each.name])
        )
        found[each.name] = replace(declared, whole=whole, listed=listed, optional=type(None) in types)
    return found


def check_settings(component: Any, path: str = "") -> None:
    """ConfigError, in one sentence with name, value and range, if a setting of a dataclass instance is out of its range.

    For `__post_init__`: a component that is made in Python is checked as one that is configured. `path` is what the
    sentence says before a setting's name, as "study.walk.".
    """
    if wrong := out_of_range(type(component), vars(component), path):
        raise ConfigError(wrong)


def out_of_range(cls: type[Any], values: Mapping[str, Any], path: str = "") -> str | None:
    """The sentence about the first of a dataclass's `values` that is out of its range; None if all are within.

    Values that are missing, or are no numbers, are not its business.
    """
    for name, allowed in ranges_of(cls).items():  # type: ignore[arg-type]  # a class is hashable
        value = values.get(name)
        if is_dataclass(value) and not isinstance(value, type):
            wrong = out_of_range(type(value), vars(value), f"{path}{name}.")
        else:
            wrong = _wrong(f"{path}{name}", value, allowed)
        if wrong:
            return wrong
    return None


def _wrong(name: str, value: Any, allowed: Range) -> str | None:
    if isinstance(value, list | tuple) and (
        len(value) < allowed.fewest or (allowed.count is not None and len(value) != allowed.count)
    ):
        number = "number" if len(value) == 1 else "numbers"
        return f"{name}={_brief(value)} holds {len(value)} {number}; give {allowed.allowed}"
    for number in _numbers(value):
        if number not in allowed:
            held = "" if number is value else f" holds {_brief(number)}, which"
            return f"{name}={_brief(value)}{held} {_reason(number, allowed)}"
    return None


def _reason(number: Any, allowed: Range) -> str:
    """What is wrong with a number, and what to give instead."""
    if _is_nan(number):
        return f"is not a number; give {allowed.allowed}"
    if allowed.finite and _is_infinite(number):
        return f"is not finite; give {allowed.allowed}"
    if allowed.whole and not _is_whole(number):
        return f"is not whole; give {allowed.allowed}"
    lowest, highest = allowed.limits  # where one is left by default, it is named
    if number > highest and allowed.below is None:
        allowed = replace(allowed, at_most=highest)
    elif number < lowest and allowed.above is None:
        allowed = replace(allowed, at_least=lowest)
    return f"is out of range; give {allowed.allowed}"


def _is_whole(number: Any) -> bool:
    return isinstance(number, int | np.integer)


def _is_nan(number: Any) -> bool:
    return not _is_whole(number) and math.isnan(number)  # an integer may be too large for a float


def _is_infinite(number: Any) -> bool:
    return not _is_whole(number) and math.isinf(number)


def _brief(value: Any) -> str:
    """A value as the user gave it, unless it fills the screen."""
    if isinstance(value, int) and value.bit_length() > 400:
        return f"(a number of {value.bit_length()} bits)"
    if isinstance(value, float):
        return f"{value:g}" if math.isclose(value, float(f"{value:g}"), rel_tol=1e-15) else repr(value)
    text = str(value)
    return text if len(text) <= 120 else f"{text[:100]} ..."


def _numbers(value: Any) -> Iterator[Any]:
    """Every number in a value, its lists and its dictionaries; truth values are none."""
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, list | tuple):
        for each in value:
            yield from _numbers(each)
    elif isinstance(value, int | float | np.number) and not isinstance(value, bool):
        yield value


def plain_types(hint: Any) -> Iterator[Any]:
    """The plain types that a type hint is made of."""
    parts = typing.get_args(hint)
    if not parts:
        yield hint
    for part in parts:
        yield from plain_types(part)


def _short(value: Any) -> str:
    """A limit as a user would write it."""
    if isinstance(value, int):
        return str(value)
    return f"{value:g}"
