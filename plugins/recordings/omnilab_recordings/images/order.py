"""The order of image files: that of the numbers in their names."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from decimal import Decimal

WHOLE = re.compile(r"(\d+)")
DECIMAL = re.compile(r"((?<![.\d])\d+\.\d+(?![.\d]*\d)|\d+)")  # of 1.2.3, no two numbers are a decimal


def in_order(names: Iterable[str]) -> list[str]:
    """Names by the numbers in them (img-2 before img-10; 1000.05 before 1000.1, as times are).

    Numbers with a point are decimals, unless one of them ends in a 0 that another number of decimals would have dropped:
    1.9 and 1.10 are the ninth and the tenth of something.
    """
    names = list(names)
    decimals = [part.rpartition(".")[2] for name in names for part in DECIMAL.split(name)[1::2] if "." in part]
    dropped = any(len(part) > 1 and part.endswith("0") for part in decimals)
    return sorted(names, key=_by(WHOLE if dropped and len(set(map(len, decimals))) > 1 else DECIMAL))


def _by(number: re.Pattern[str]) -> Callable[[str], tuple[list[str | Decimal], str]]:
    # the odd pieces are the numbers, so that text never meets a number
    return lambda name: ([Decimal(part) if i % 2 else part for i, part in enumerate(number.split(name))], name)
