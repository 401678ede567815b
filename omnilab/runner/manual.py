"""A component's settings as its source has them: for the manual, and as data for a form."""

from __future__ import annotations

import ast
import inspect
import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, asdict, fields, is_dataclass
from enum import Enum
from functools import lru_cache
from types import UnionType
from typing import Any, get_origin, get_type_hints

from omnilab.api.settings import Range, plain_types, ranges_of

NUMBERS = {int, float, Any}  # types of settings that may be numbers
UNITS = {  # by the end of a setting's name
    "m": "m", "mm": "mm", "deg": "deg", "rad": "rad", "px": "px", "s": "s", "ms": "ms", "ns": "ns", "gb": "GB", "hz": "Hz",
}  # fmt: skip

Written = tuple[ast.AnnAssign, str]  # a declaration, and the comment behind it


def settings_of(cls: type[Any]) -> list[str]:
    """A line for each of a component's settings: name, type and default, its range, the comment in its source."""
    declared = {field.name: field for field in fields(cls)}
    return [_line(declared[name], *written) for name, written in _source(cls).items()]


def settings_data(cls: type[Any]) -> list[dict[str, Any]]:
    """Each of a component's settings, for JSON: `name`, `type`, `unit` or null, `comment`, and what it may be.

    `required` settings have no `default`. `range` is null, or the limits of each number: `lowest` and `highest`, those
    that hold for all included, `above` and `below` where the limit itself is out, `multiple_of`, `whole`, `count` and
    `fewest` of a list's numbers, and all of it in words, `allowed`. `choices` are an enumeration's names, and null where it may be that;
    `settings` are those of a setting that has its own. `writes`: it names a file or a folder that is written.
    """
    hints, ranges, source = get_type_hints(cls), ranges_of(cls), _source(cls)  # type: ignore[arg-type]  # a class is hashable
    return [_data(field, hints[field.name], ranges[field.name], *source[field.name]) for field in fields(cls)]


def _data(field: Field[Any], hint: Any, allowed: Range, node: ast.AnnAssign, comment: str) -> dict[str, Any]:
    default = field.default if field.default_factory is MISSING else field.default_factory()
    required = default is MISSING or default == "???"
    found: dict[str, Any] = {
        "name": field.name,
        "type": ast.unparse(node.annotation),
        "required": required,
        "default": None if required else _plain(default),
        "unit": UNITS.get(field.name.rpartition("_")[2]) if "_" in field.name else None,
        "comment": comment,
        "range": _range(allowed) if NUMBERS & set(plain_types(hint)) else None,
        "writes": field.metadata.get("writes", False),
    }
    enums = [each for each in plain_types(hint) if isinstance(each, type) and issubclass(each, Enum)]
    if enums and get_origin(hint) in {None, UnionType}:
        found["choices"] = [member.name for member in enums[0]] + ["null"] * (type(None) in plain_types(hint))
    if isinstance(hint, type) and is_dataclass(hint):
        found["settings"] = settings_data(hint)
    return found


def _range(allowed: Range) -> dict[str, Any]:
    lowest, highest = (None if math.isinf(limit) else limit for limit in allowed.limits)
    lowest = lowest if allowed.above is None else None  # the limit by default says less
    highest = highest if allowed.below is None else None
    words = {name: value for name, value in asdict(allowed).items() if name not in {"at_least", "at_most", "listed"}}
    return {"lowest": lowest, "highest": highest, **words, "allowed": allowed.allowed}


def _plain(value: Any) -> Any:
    """A default as JSON has it."""
    if isinstance(value, Enum):
        return value.name
    if is_dataclass(value) and not isinstance(value, type):
        return {name: _plain(inner) for name, inner in vars(value).items()}
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _source(cls: type[Any]) -> Mapping[str, Written]:
    """Of each setting, where it is declared in the source, and the comment behind it."""
    names = {field.name for field in fields(cls)}
    found: dict[str, Written] = {}
    for owner in (c for c in reversed(cls.__mro__) if "__dataclass_fields__" in vars(c)):
        lines, _ = inspect.findsource(inspect.getmodule(owner))  # type: ignore[arg-type]  # None raises TypeError
        declared = _declared("".join(lines)).get(owner.__qualname__)
        if declared is None:
            raise OSError(f"the source of {owner.__qualname__} is not in its module")
        found |= {name: written for name, written in declared.items() if name in names}
    return found


@lru_cache(maxsize=256)
def _declared(source: str) -> Mapping[str, Mapping[str, Written]]:
    """Of each class in a module's source, by its qualified name: what is declared in it, with the comment behind it."""
    lines, found = source.split("\n"), dict[str, dict[str, Written]]()

    def look_in(node: ast.AST, within: str) -> None:
        for inner in ast.iter_child_nodes(node):
            if isinstance(inner, ast.ClassDef):
                declared = (each for each in inner.body if isinstance(each, ast.AnnAssign))
                found[within + inner.name] = {
                    each.target.id: (each, _comment(each, lines))
                    for each in declared
                    if isinstance(each.target, ast.Name)
                }
                look_in(inner, f"{within}{inner.name}.")
            elif isinstance(inner, ast.FunctionDef | ast.AsyncFunctionDef):
                look_in(inner, f"{within}{inner.name}.<locals>.")
            elif isinstance(inner, ast.stmt | ast.ExceptHandler | ast.match_case):
                look_in(inner, within)

    look_in(ast.parse(source), "")
    return found


def _comment(node: ast.AnnAssign, source: Sequence[str]) -> str:
    assert node.end_lineno is not None
    return source[node.end_lineno - 1].encode()[node.end_col_offset :].decode().partition("#")[2].strip()


def _line(field: Field[Any], node: ast.AnnAssign, comment: str) -> str:
    value = node.value
    if isinstance(value, ast.Call) and ast.unparse(value.func) == "setting" and value.args:
        value = value.args[0]
    declared = f"{field.name}: {ast.unparse(node.annotation)}" + (f" = {ast.unparse(value)}" if value else "")
    interval = field.metadata["range"].interval if "range" in field.metadata else ""
    rest = "; ".join(part for part in (comment, interval) if part)
    return f"{declared}  # {rest}" if rest else declared
