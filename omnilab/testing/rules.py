"""Rules of the contract, tried on a component one by one."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, ClassVar, TypeVar

from omnilab.errors import OmnilabError
from omnilab.runner.boundaries import guard
from omnilab.testing.common import check_common, expect

Method = TypeVar("Method", bound=Callable[..., None])
OK, FAILED, UNCHECKED = "ok", "failed", "unchecked"


class CannotCheckError(Exception):
    """A rule that says nothing of this component, and why."""


@dataclass(frozen=True)
class Verdict:
    """What came of a rule."""

    rule: str
    state: str  # OK, FAILED or UNCHECKED
    why: str = ""  # what is wrong, or why it cannot be checked
    error: BaseException | None = None


@dataclass(frozen=True)
class Work:
    """What is measured of a component."""

    call: Callable[[], Any]
    count: int  # of units that a call does
    unit: str


def rule(says: str) -> Callable[[Method], Method]:
    """Marks a method of a `Trial` as a rule; the method raises what is wrong, with what fixes it."""

    def marked(method: Method) -> Method:
        method.says = says  # type: ignore[attr-defined]
        return method

    return marked


class Trial:
    """A component, what it is shown, and the rules that it must keep, in the order in which they stand."""

    kind: ClassVar[str]

    def __init__(self, component: Any) -> None:
        self.given, self.settings = component, _settings(component)

    @cached_property
    def component(self) -> Any:
        """As a run uses it: what its methods return is checked, and what they are given is read-only."""
        return guard(self.given, self.kind, type(self.given).__name__)

    def work(self) -> Work | None:
        """What time and memory are measured of."""
        return None

    @rule("is a documented dataclass with the contract's members that survives pickling")
    def is_component(self) -> None:
        check_common(self.kind, self.given)


def rules_of(trial: Trial) -> Iterator[Callable[[], None]]:
    """The rules of a trial, those of its base first; at last the one that can only be checked then."""
    names = dict.fromkeys(
        name for cls in reversed(type(trial).__mro__) for name, value in vars(cls).items() if hasattr(value, "says")
    )
    for name in names:
        yield getattr(trial, name)
    yield _Unchanged(trial)


class _Unchanged:
    """The last rule."""

    says = "stays as it was set, whatever it is asked to do"

    def __init__(self, trial: Trial) -> None:
        self.trial = trial

    def __call__(self) -> None:
        now = _settings(self.trial.component)
        changed = [name for name, value in self.trial.settings.items() if repr(now[name]) != repr(value)]
        expect(
            not changed,
            f"its setting {changed and changed[0]} is another after it was used; keep what changes in local variables",
        )


def conform(trial: Trial) -> None:
    """AssertionError, or what the component raises, at the first rule that is broken."""
    for each in rules_of(trial):
        try:
            each()
        except CannotCheckError:
            continue


def verdicts(trial: Trial) -> Iterator[Verdict]:
    """What comes of each rule. One that fails as a rule before it cannot be checked."""
    seen: dict[str, str] = {}
    for each in rules_of(trial):
        says = str(each.says)  # type: ignore[attr-defined]
        try:
            each()
        except CannotCheckError as reason:
            yield Verdict(says, UNCHECKED, str(reason))
        except Exception as error:  # noqa: BLE001  whatever it does wrong, the next rule is tried
            why = _sentence(error)
            if why in seen:
                yield Verdict(says, UNCHECKED, f"see '{seen[why]}'")
            else:
                seen[why] = says
                yield Verdict(says, FAILED, why, error)
        else:
            yield Verdict(says, OK)


def _sentence(error: Exception) -> str:
    text = " ".join(str(error).split())
    if isinstance(error, AssertionError | OmnilabError) and text:
        return re.sub(r", and try omnilab\.testing\.check_\w+ on it", "", text)  # as is being done
    return f"it raises {type(error).__name__}{f': {text}' if text else ''}; correct that (-v shows where)"


def _fields(component: Any) -> tuple[Any, ...]:
    """None of what is no dataclass, which its first rule says."""
    return fields(component) if hasattr(component, "__dataclass_fields__") else ()


def _settings(component: Any) -> dict[str, Any]:
    return {each.name: deepcopy(getattr(component, each.name, None)) for each in _fields(component)}
