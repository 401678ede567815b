"""Guards components: what they return is checked on its way out, and what they raise names them.

What they are given is read-only, for others have it, too; what they return is the caller's own.

The components stay plain dataclasses: a guarded one is a copy, of a class derived from its own. What a component calls
of itself passes no boundary, and is not checked.
"""

from __future__ import annotations

import copy
import re
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache, wraps
from inspect import signature
from typing import Any

from omnilab.api import KINDS
from omnilab.errors import OmnilabError, PluginError
from omnilab.runner.boundaries.images import Memory, Prepared, all_frames, in_order
from omnilab.runner.boundaries.passing import holds_arrays, read_only, unshared
from omnilab.runner.boundaries.returns import BEGUN, CHECKS, PROTOCOLS, Check
from omnilab.runner.boundaries.spot_checks import SpotCheck
from omnilab.runner.boundaries.values import ITEMS, Wrong, named

HANDED_BACK: dict[str, set[int | str]] = {  # arguments that a component made itself: by number, or by name
    "match": {1, "index"}, "locate": {1, "index"}, "track": {1, "index"}, "estimate": {0, 1, "before", "now"}
}  # fmt: skip
OPAQUE = {"fit", "restore"}  # what these return is no data
SEEN = "_passed_the_boundary"  # an attribute of guarded components: what is to be remembered of earlier results
END = object()


class _Inside(threading.local):
    """Which components of this thread are at work: calls of theirs to themselves pass no boundary."""

    def __init__(self) -> None:
        self.ids: set[int] = set()


_inside = _Inside()


def guard(component: Any, kind: str, title: str, spot_check: SpotCheck | None = None) -> Any:
    """A component like the given one, of a class derived from its own, whose methods check what they return.

    `kind` is one of `KINDS`, or of `returns.BEGUN`; `title` names component and plugin in sentences. A `spot_check` is
    shown the first images that a descriptor is given.
    """
    guarded = _in_place(copy.copy(component), kind, title)
    if spot_check is not None:
        _memory(guarded)["spot_check"] = spot_check
    return guarded


def _in_place(made: Any, kind: str, title: str) -> Any:
    """The same for what no one else holds: it becomes a guarded one itself."""
    if SEEN not in vars(type(made)):
        with suppress(TypeError):  # a class that was written in C allows no such change
            object.__setattr__(made, "__class__", _derived(type(made), kind, title))  # type: ignore[arg-type]  # classes hash
    return made


def ending(error: BaseException, title: str) -> PluginError:
    """The sentence about a component that raised what is no Exception, such as SystemExit."""
    cause = " ".join(f"{type(error).__name__}: {error}".split())
    return PluginError(f"{title} tried to end the process ({cause}); raise an Exception there, such as a DataError")


def _inputs(plain: Callable[..., Any], values: Sequence[Any], more: dict[str, Any]) -> str:
    """The inputs of a method that hold arrays, by name."""
    if plain is next:  # of a sensor's batches
        return "its input `plan`"
    names = list(signature(plain).parameters)
    held = [name for name, value in [*zip(names[1:], values, strict=False), *more.items()] if holds_arrays(value)]
    return f"its input {' or '.join(f'`{name}`' for name in held)}" if held else "one of its inputs"


def _several(item: str) -> str:
    """The plural: queries, images."""
    return f"{item[:-1]}ies" if item.endswith("y") else f"{item}s"


@cache
def _derived(cls: type[Any], kind: str, title: str) -> type[Any]:
    """The class of guarded components."""
    members: dict[str, Any] = {
        "__module__": cls.__module__,
        "__qualname__": cls.__qualname__,
        "__doc__": cls.__doc__,
        "__slots__": (),
        SEEN: None,
        "__reduce__": lambda own: (guard, (_plain(own, cls), kind, title)),
    }
    boundary = _Boundary(kind, title)
    for name, check in CHECKS.get(kind, {}).items():
        if hasattr(cls, name):
            make = boundary.frames if name == "frames" else boundary.method
            members[name] = make(getattr(cls, name), name, check)
    if kind in {"distance", "localizer"}:
        members["prepare"] = boundary.prepare(cls.prepare)
    if kind in BEGUN and hasattr(cls, "begin"):
        members["begin"] = boundary.begin(cls.begin)
    return type(cls.__name__, (cls,), members)


def _plain(guarded: Any, cls: type[Any]) -> Any:
    """A guarded component as the one it was made from."""
    plain = object.__new__(cls)
    for base in cls.__mro__:
        for name in getattr(base, "__slots__", ()):
            with suppress(AttributeError):
                object.__setattr__(plain, name, getattr(guarded, name))
    for name, value in getattr(guarded, "__dict__", {}).items():
        if name != SEEN:
            object.__setattr__(plain, name, value)
    return plain


class _Boundary:
    """Makes the methods of guarded components of one kind and title."""

    def __init__(self, kind: str, title: str) -> None:
        self.kind, self.title = kind, title

    def method(self, plain: Callable[..., Any], name: str, check: Check) -> Callable[..., Any]:
        """A method whose result is checked."""

        @wraps(plain)
        def method(own: Any, *values: Any, **more: Any) -> Any:
            fresh, passes = self._call(plain, name, own, values, more)
            found = unshared(fresh) if passes and name not in OPAQUE else fresh.pop()
            if passes:
                with self._sentences(name, check.item):
                    check.check(found, *values, **more)
                    if check.beside is not None:
                        check.beside(_memory(own), found, *values, **more)
                self._spot_check(_memory(own).get("spot_check"), name, found, values)
            if name in OPAQUE and passes:
                return _in_place(found, "descriptor", self.title)
            return found

        return method

    def _spot_check(self, spot_check: SpotCheck | None, name: str, found: Any, values: Sequence[Any]) -> None:
        """Show a spot check what was described; what was trained gets one of its own."""
        if spot_check is None:
            return
        if name == "describe":
            spot_check(found, *values)
        elif name in OPAQUE:
            plain = copy.copy(found)
            _memory(_in_place(found, "descriptor", self.title))["spot_check"] = SpotCheck(
                plain, self.title, spot_check.name
            )

    def frames(self, plain: Callable[..., Any], name: str, check: Check) -> Callable[..., Any]:
        """The method of sensors: every batch is checked, and that all planned frames came."""

        @wraps(plain)
        def frames(own: Any, plan: Any) -> Iterator[Any]:
            (found,), passes = self._call(plain, name, own, (plan,), {})
            if not passes:
                yield from found
                return
            with self._sentences(name, check.item):
                if not hasattr(found, "__iter__"):
                    raise Wrong(f"{named(found)}, not batches of frames")
            batches, delivered, left_out, last = iter(found), 0, 0, -1
            while (batch := unshared(self._call(next, name, batches, (END,), {}, own)[0])) is not END:
                with self._sentences(name, check.item):
                    check.check(batch, plan)
                    last = in_order(batch, last)
                delivered, left_out = delivered + len(batch), left_out + len(batch.omitted)
                yield batch
            if not getattr(own, "live", False):
                with self._sentences(name, check.item):
                    all_frames(delivered, left_out, plan)

        return frames

    def prepare(self, plain: Callable[..., Any]) -> Callable[..., Any]:
        """The method of distances and localizers: how many places there were goes along with what it returns."""

        @wraps(plain)
        def prepare(own: Any, places: Any, *others: Any) -> Any:
            (found,), passes = self._call(plain, "prepare", own, (places, *others), {})
            return Prepared(found, len(places)) if passes else found

        return prepare

    def begin(self, plain: Callable[..., Any]) -> Callable[..., Any]:
        """The method that begins a map: what it returns is guarded, too."""
        kind = BEGUN[self.kind]

        @wraps(plain)
        def begin(own: Any, *values: Any) -> Any:
            (found,), passes = self._call(plain, "begin", own, values, {})
            if not passes:
                return found
            with self._sentences("begin"):
                lacking = [name for name in CHECKS[kind] if not callable(getattr(found, name, None))]
                if lacking:
                    raise Wrong(f"{named(found)}, which has no {' and no '.join(lacking)}")
            made = _in_place(found, kind, self.title)
            if values:  # the first pose
                _memory(made)["width"] = len(values[0])
            return made

        return begin

    def _call(
        self, plain: Callable[..., Any], name: str, own: Any, values: Sequence[Any], more: dict[str, Any],
        whose: Any = None,
    ) -> tuple[list[Any], bool]:  # fmt: skip
        """What a method returns, held by a list alone, and whether it passes the boundary; what it raises names the component.

        `whose`: the component, where it is not the first argument.
        """
        identity = id(own if whose is None else whose)
        passes, made = identity not in _inside.ids, HANDED_BACK.get(name, set())

        def given(where: int | str, value: Any) -> Any:
            if isinstance(value, Prepared):
                return value.own
            return read_only(value) if passes and where not in made else value

        values = [given(i, value) for i, value in enumerate(values)]
        more = {key: given(key, value) for key, value in more.items()}
        if not passes:
            return [plain(own, *values, **more)], False
        _inside.ids.add(identity)
        try:
            return [plain(own, *values, **more)], True
        except (OmnilabError, KeyboardInterrupt, GeneratorExit):
            raise
        except Exception as error:
            if not isinstance(error, OSError) and re.search("(?i)read-?only", str(error)):
                raise PluginError(f"{self.title}: {name} writes into {_inputs(plain, values, more)}, which others have,"
                                  " too; copy it first") from error  # fmt: skip
            error.add_note(f"raised by {self.title}, in {name}")
            raise
        except BaseException as error:  # SystemExit, or a panic of a library: neither may end the process
            raise ending(error, f"{self.title}, in {name},") from error
        finally:
            _inside.ids.discard(identity)

    @contextmanager
    def _sentences(self, name: str, item: str = "") -> Iterator[None]:
        """PluginError for what is wrong, with where to read what is right."""
        try:
            yield
        except Wrong as wrong:
            text = str(wrong).replace(f" {ITEMS},", f" {_several(item)}," if item else ",")
            error = PluginError(f"{self.title}: {name} returns {text}; {self._advice}")
            error.item = wrong.item if item else None
            raise error from None

    @property
    def _advice(self) -> str:
        protocol = PROTOCOLS.get(self.kind) or KINDS[self.kind].protocol
        first = next((kind for kind, begun in BEGUN.items() if begun == self.kind), self.kind)
        return f"see {protocol.__name__} in omnilab.api, and try omnilab.testing.check_{first} on it"


def _memory(component: Any) -> Memory:
    """What is remembered of earlier results of a component."""
    seen: Memory | None = getattr(component, SEEN, None)
    if seen is None:
        seen = {}
        with suppress(AttributeError):  # of a class with slots
            object.__setattr__(component, SEEN, seen)
    return seen
