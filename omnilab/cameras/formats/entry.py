"""One camera of a calibration file as parsed, and what a reader makes of it."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omnilab.cameras.lenses import AxialCamera
from omnilab.cameras.plausibility import brief
from omnilab.errors import DataError, did_you_mean

NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")  # YAML takes 1e-3 for a text
Size = tuple[int, int]  # width and height in pixels


@dataclass(frozen=True)
class CameraParameters:
    """A camera as a file describes it, but for where it looks, and perhaps for the size of its images."""

    model: type[AxialCamera]
    settings: Mapping[str, Any]  # of the model
    size: Size | None  # None: the file does not say
    unused: Sequence[str] = ()  # keys of the file that mean something and are of no use here


@dataclass(frozen=True)
class Entry:
    """The values of one camera in a file; what is missing or wrong among them is said by file and key."""

    file: Path
    name: str  # "" where the file has but one camera
    values: Mapping[str, Any]

    @property
    def title(self) -> str:
        """The file and, where it has several cameras, which of them."""
        return f"{self.file} ({self.name})" if self.name else str(self.file)

    def value(self, key: str) -> Any:
        """What stands under a key; DataError if it is not there."""
        if key not in self.values:
            raise DataError(f"{self.title} has no {key}{did_you_mean(key, map(str, self.values))}; add it")
        return self.values[key]

    def group(self, key: str) -> Entry:
        """The values below a key."""
        found = self.value(key)
        if not isinstance(found, Mapping):
            raise DataError(f"{self.title} has {key}={brief(found)}; write names and numbers below it")
        return Entry(self.file, f"{self.name} {key}".strip(), found)

    def number(self, key: str) -> float:
        """A finite number."""
        return self.numbers(key, 1)[0]

    def numbers(self, key: str, *counts: int) -> list[float]:
        """Finite numbers, as many as one of `counts`: a list, rows of lists, or a matrix of OpenCV or ROS."""
        found = self.value(key)
        numbers = [_number(value) for value in _flat(found)]
        if any(number is None for number in numbers) or len(numbers) not in counts:
            wanted = " or ".join(map(str, counts))
            raise DataError(f"{self.title} has {key}={brief(found)}; write {wanted} finite number(s)")
        return [number for number in numbers if number is not None]

    def count(self, key: str) -> int:
        """How many values stand under a key."""
        return len(_flat(self.value(key)))

    def size(self, width: str, height: str) -> Size | None:
        """Width and height in pixels; None where the file has neither."""
        if width not in self.values and height not in self.values:
            return None
        return self._pixels(width, self.number(width)), self._pixels(height, self.number(height))

    def size_of(self, key: str) -> Size | None:
        """Width and height in pixels under one key; None where there is none."""
        if key not in self.values:
            return None
        width, height = self.numbers(key, 2)
        return self._pixels(key, width), self._pixels(key, height)

    def word(self, key: str) -> str:
        """A text in lower case."""
        found = self.value(key)
        if not isinstance(found, str):
            raise DataError(f"{self.title} has {key}={brief(found)}; write a word")
        return found.strip().lower()

    def _pixels(self, key: str, number: float) -> int:
        if not number.is_integer():
            raise DataError(f"{self.title} has {key}={number:g}; write whole pixels")
        return int(number)


def _flat(value: Any) -> list[Any]:
    """The values of a number, a list, rows of lists, or a matrix with `data`; what is none of these as it is."""
    if isinstance(value, Mapping) and isinstance(value.get("data"), list):
        rows, columns = value.get("rows", 1), value.get("cols", value.get("columns", len(value["data"])))
        whole = isinstance(rows, int) and isinstance(columns, int) and rows * columns == len(value["data"])
        return value["data"] if whole else [None]
    if isinstance(value, list):
        return [number for row in value for number in (row if isinstance(row, list) else [row])]
    return [value]


def _number(value: Any) -> float | None:
    """A finite number of at most a double's size; None of anything else."""
    if isinstance(value, str) and NUMBER.fullmatch(value.strip()):
        value = float(value)
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e300:
        return None
    return float(value) if math.isfinite(value) else None
