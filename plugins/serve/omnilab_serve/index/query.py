"""The language in which runs are searched: words, `state:failed`, `step_m>0.2`, `-term`, quotes around words with spaces."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import lru_cache
from typing import Any

from omnilab.client import RunRecord
from omnilab.errors import ConfigError
from omnilab_serve.index.values import FIELDS, values

LONGEST = 1000  # characters of a query
COMPARE: dict[str, Callable[[float, float], bool]] = {
    ">": operator.gt, ">=": operator.ge, "<": operator.lt, "<=": operator.le,
}  # fmt: skip
EQUAL = (":", "=")
TOKEN = re.compile(r'\s*((?:"[^"]*"|[^\s"])+)')
TERM = re.compile(r"(-?)(?:([A-Za-z_][\w.@/]*)(>=|<=|[:=<>]))?(.*)", re.DOTALL)


@dataclass(frozen=True)
class Term:
    """One condition; without a name, a word that a run has somewhere."""

    name: str
    sign: str
    text: str
    negated: bool = False

    def matches(self, record: RunRecord) -> bool:
        return self._holds(record) != self.negated

    def _holds(self, record: RunRecord) -> bool:
        if not self.name:
            return self.text in _words(record)
        found = values(record, self.name)
        if self.sign in EQUAL:
            return any(_equals(value, self.text) for value in found)
        compare, limit = COMPARE[self.sign], float(self.text)
        return any(compare(value, limit) for value in found if type(value) in (int, float))


@dataclass(frozen=True)
class RunQuery:
    """Terms, all of which a run must meet."""

    terms: Sequence[Term] = ()

    def matches(self, record: RunRecord) -> bool:
        return all(term.matches(record) for term in self.terms)

    def unknown(self, records: Sequence[RunRecord]) -> list[str]:
        """The names in it of which no record has anything."""
        names = dict.fromkeys(term.name for term in self.terms if term.name and term.name not in FIELDS)
        return [name for name in names if not any(values(record, name) for record in records)]


@lru_cache(maxsize=100)
def parse(text: str) -> RunQuery:
    """A query; ConfigError in a sentence for what cannot be read."""
    if len(text) > LONGEST:
        raise ConfigError(f"the filter has {len(text)} characters; give up to {LONGEST}")
    if text.count('"') % 2:
        raise ConfigError(f'a quote is open in the filter {text}; close it, as in "two words"')
    return RunQuery(tuple(map(_term, TOKEN.findall(text))))


def _term(token: str) -> Term:
    match = TERM.fullmatch(token)
    minus, name, sign, rest = match.groups() if match else ("", None, None, token)
    value = rest.replace('"', "")
    if not value:
        hint = f"{name}{sign}{'0.2' if sign in COMPARE else 'value'}" if name else "-state:failed"
        raise ConfigError(f"the filter {token} says nothing to compare with; write, for example, {hint}")
    if sign in COMPARE and _number(value) is None:
        raise ConfigError(
            f"the filter {token} needs a number behind {sign}, not {value}; for a text write {name}:{value}"
        )
    return Term(name or "", sign or "", value.casefold(), bool(minus))


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return None if value != value else value  # noqa: PLR0124  NaN compares with nothing


def _words(record: RunRecord) -> str:
    """All in which free words are looked for."""
    return "\n".join((record.path, record.experiment, record.state, record.host or "", *record.overrides)).casefold()


def _equals(value: Any, text: str) -> bool:
    """Whether a value is what a text says, in which `*` stands for anything; a number by its size."""
    if type(value) in (int, float) and (number := _number(text)) is not None:
        return bool(value == number)
    shown = _shown(value).casefold()
    return fnmatchcase(shown, text.replace("[", "[[]").replace("?", "[?]")) if "*" in text else shown == text


def _shown(value: Any) -> str:
    """A value as an override would say it."""
    match value:
        case None | True | False:
            return {None: "null", True: "true", False: "false"}[value]
        case list() | tuple():
            return f"[{','.join(map(_shown, value))}]"
        case _:
            return str(value)
