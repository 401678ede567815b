"""World files as checked sections: every complaint is one sentence that names file, line and key."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Iterator
from copy import copy
from pathlib import Path
from typing import Any

import yaml

from omnilab.errors import DataError

MAX_BYTES = 1_000_000
MAX_DEPTH = 16
MAX_NODES = 100_000
REQUIRED = object()


class Section:
    """A mapping of a world file. Values are taken by name and checked; `done` refuses the rest."""

    def __init__(self, file: Path, title: str, node: yaml.Node) -> None:
        self.file, self.title, self.line = file, title, _line(node)
        if not isinstance(node, yaml.MappingNode):
            raise self.wrong(f"is not a list of 'key: value' entries; write {title} as a mapping")
        self._nodes: dict[str, yaml.Node] = {}
        self._taken: set[str] = set()
        for key, value in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise self.wrong("has a key that is not a name; write 'key: value'", key)
            if key.value in self._nodes:
                raise self.wrong(f"has the key '{key.value}' twice; remove one", value)
            self._nodes[str(key.value)] = value

    def wrong(self, problem: str, node: yaml.Node | None = None) -> DataError:
        """The error to raise: where it is and what is wrong with it."""
        line = self.line if node is None else _line(node)
        return DataError(f"{self.file}, line {line}: {self.title} {problem}")

    def __contains__(self, key: str) -> bool:
        return key in self._nodes

    def keys(self) -> Iterator[str]:
        return iter(self._nodes)

    def done(self) -> None:
        """Refuse the keys that were not read."""
        for key in self._nodes.keys() - self._taken:
            raise self.wrong(f"has an unknown key '{key}'; {suggestion(key, self._taken)}", self._nodes[key])

    def invalid(self, key: str, value: Any, expected: str) -> DataError:
        """The error for a key whose value is not what was expected."""
        return self.wrong(f"has {key}={value!r}; expected {expected}", self._nodes[key])

    def value(self, key: str, default: Any = REQUIRED) -> Any:
        """The plain value of a key, whatever its type."""
        self._taken.add(key)
        if key not in self._nodes:
            if default is REQUIRED:
                raise self.wrong(f"lacks the key '{key}'; add it")
            return default
        try:
            return _Values().construct_document(self._nodes[key])
        except (yaml.YAMLError, ValueError) as error:
            raise self.wrong(
                f"has a value of '{key}' that cannot be read ({_cause(error)}); correct it", self._nodes[key]
            ) from None

    def number(self, key: str, default: Any = REQUIRED, low: float = -math.inf, high: float = math.inf) -> float:
        """A finite number from `low` to `high`."""
        value = self.value(key, default)
        if not _is_number(value) or not low <= value <= high:
            limits = "" if math.isinf(low) and math.isinf(high) else f" from {low:g} to {high:g}"
            raise self.invalid(key, value, f"a finite number{limits}")
        return float(value)

    def numbers(self, key: str, count: int, default: Any = REQUIRED, low: float = -math.inf) -> list[float]:
        """A list of `count` finite numbers, none below `low`."""
        value = self.value(key, default)
        if not _is_point(value, count) or min(value) < low:
            limit = "" if math.isinf(low) else f", each at least {low:g}"
            raise self.invalid(key, value, f"a list of {count} finite numbers{limit}")
        return [float(number) for number in value]

    def size(self, key: str, count: int, default: Any = REQUIRED) -> list[float]:
        """`count` lengths in metres, each at least a millimetre."""
        return self.numbers(key, count, default, low=0.001)

    def points(self, key: str, count: int = 3) -> list[list[float]]:
        """A list of points of `count` coordinates."""
        value = self.value(key)
        if not isinstance(value, list) or not all(_is_point(point, count) for point in value):
            raise self.invalid(key, value, f"a list of points [{', '.join('xyz'[:count])}] of finite numbers")
        return value

    def color(self, key: str, default: Any = REQUIRED) -> list[float]:
        """Red, green and blue from 0 to 255."""
        value = self.value(key, default)
        self._check_color(key, value)
        return [float(part) for part in value]

    def colors(self, key: str, default: Any = REQUIRED) -> list[list[float]]:
        """A list of colours."""
        value = self.value(key, default)
        if not isinstance(value, list) or not value:
            raise self.invalid(key, value, "a list of colours [red, green, blue], each from 0 to 255")
        for color in value:
            self._check_color(key, color)
        return value

    def _check_color(self, key: str, value: Any) -> None:
        if not _is_point(value, 3) or not all(0 <= part <= 255 for part in value):
            raise self.invalid(key, value, "a colour [red, green, blue], each from 0 to 255")
        if 0 < max(value) <= 1:  # hardly anybody means a black that cannot be told from black
            larger = [round(255 * part) for part in value]
            raise self.invalid(
                key, value, f"a colour from 0 to 255: {larger} if this one is from 0 to 1, [0, 0, 0] for black"
            )

    def flag(self, key: str, default: bool) -> bool:
        """true or false."""
        value = self.value(key, default)
        if not isinstance(value, bool):
            raise self.invalid(key, value, "true or false")
        return value

    def word(self, key: str, default: Any = REQUIRED) -> str:
        """A text."""
        value = self.value(key, default)
        if not isinstance(value, str) or not value:
            raise self.invalid(key, value, "a name")
        return value

    def words(self, key: str) -> list[str]:
        """A list of names, empty where there is no such key."""
        value = self.value(key, [])
        if not isinstance(value, list) or not all(isinstance(word, str) for word in value):
            raise self.invalid(key, value, "a list of names")
        return value

    def choice(self, key: str, options: Iterable[str], default: Any = REQUIRED) -> str:
        """One of the names in `options`."""
        value, options = self.word(key, default), list(options)
        if value not in options:
            raise self.wrong(f"has an unknown {key} '{value}'; {suggestion(value, options)}", self._nodes[key])
        return value

    def section(self, key: str) -> Section:
        """The mapping below a key."""
        self.value(key)
        return Section(self.file, f"'{key}'", self._nodes[key])

    def sections(self, key: str, title: str) -> list[Section]:
        """The mappings listed below a key; none where there is no such key."""
        value = self.value(key, [])
        if not isinstance(value, list):
            raise self.invalid(key, value, "a list of entries, each starting with '-'")
        return [
            Section(self.file, f"{title} {i + 1}", node)
            for i, node in enumerate(self._nodes[key].value if value else [])
        ]

    def named(self, key: str) -> dict[str, Section]:
        """The mappings below a key, by name; none where there is no such key."""
        if key not in self:
            self.value(key, None)
            return {}
        below = self.section(key)
        return {name: below.section(name) for name in below.keys()}  # noqa: SIM118

    def changed(self, other: Section) -> Section:
        """This section with another's keys in place of, or beside, its own."""
        result = copy(self)
        result._nodes, result._taken = {**self._nodes, **other._nodes}, set()
        return result


class _Values(yaml.constructor.SafeConstructor):
    """Plain values out of nodes."""


def read(file: Path, data: bytes) -> Section:
    """The top of a world file. Refused are files that are large, deeply nested or refer back to themselves."""
    if len(data) > MAX_BYTES:
        raise DataError(
            f"{file} has {len(data)} bytes; a world file may have {MAX_BYTES}, split the world or shorten it"
        )
    _check_text(file, data)
    try:
        _check_shape(file, data)
        node = yaml.compose(data, Loader=yaml.CSafeLoader)
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark else ""
        tab = mark is not None and b"\t" in b"".join(data.splitlines()[mark.line : mark.line + 1])
        cause = "a tab is in it, and YAML is indented by blanks" if tab else _cause(error)
        raise DataError(f"{file}{where}: {cause}; a world file is YAML text") from None
    if node is None:
        raise DataError(f"{file} is empty; a world file lists at least 'map_m' and 'objects'")
    return Section(file, "the world", node)


def _check_text(file: Path, data: bytes) -> None:
    if data[:2] in {b"\xff\xfe", b"\xfe\xff"}:  # UTF-16, which YAML may be
        return
    try:
        data.decode()
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise DataError(f"{file}, line {line}: a letter is not in UTF-8; save the world file as UTF-8 text") from None


def _check_shape(file: Path, data: bytes) -> None:
    depth = 0
    for count, event in enumerate(yaml.parse(data, Loader=yaml.CSafeLoader)):
        line = _line(event)
        if isinstance(event, yaml.AliasEvent):
            raise DataError(f"{file}, line {line}: '*{event.anchor}' is an alias; write the value out")
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > MAX_DEPTH or count > MAX_NODES:
            raise DataError(
                f"{file}, line {line}: nested deeper than {MAX_DEPTH} levels or longer than {MAX_NODES} values"
            )


def suggestion(name: str, options: Iterable[str]) -> str:
    """What the name may have been meant to be."""
    options = sorted(options)
    close = difflib.get_close_matches(name, options, n=1)
    return (f"did you mean '{close[0]}'? " if close else "") + "known: " + ", ".join(options)


def _cause(error: Exception) -> str:
    return str(getattr(error, "problem", None) or error).replace("\n", " ")


def _line(part: Any) -> int:
    return int(part.start_mark.line) + 1


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < 1e9


def _is_point(value: Any, count: int) -> bool:
    return isinstance(value, list) and len(value) == count and all(_is_number(part) for part in value)
