"""Numeric settings of components, and the parts of a run with one of them at another value."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any, NamedTuple, get_type_hints

from omnilab.api import Parts
from omnilab.api.settings import out_of_range, plain_types, ranges_of
from omnilab.errors import ConfigError, did_you_mean
from omnilab_studies.common.methods import Method, methods_of

MEASURED = ("sensor", "descriptor", "distance", "localizer", "descriptors", "distances", "disturbances")  # slots
EXAMPLE = "{of:descriptor.angles,values:[45,90,180]}"
OF_ALL = ("sensor", "localizer", "disturbances")  # a change of these is one of every method


class Parameter(NamedTuple):
    """A parameter: the settings that have its value, and the values in turn."""

    of: Sequence[str]  # paths as on the command line: descriptor.angles, descriptors.NAME.angles
    values: Sequence[float]  # rising


class Variant(NamedTuple):
    """The parts of a run with a parameter at one value, and the methods that it is of."""

    parameter: str
    value: float
    parts: Parts
    methods: Sequence[Method]


def parameters_of(given: Mapping[str, Any]) -> dict[str, Parameter]:
    """The setting `parameters`, without those that are null; ConfigError unless each has a name for files, settings, numbers."""
    return {name: _parameter(name, each) for name, each in given.items() if each is not None}


def _parameter(name: str, given: Any) -> Parameter:
    where = f"study.parameters.{name}"
    if not re.fullmatch(r"\w+", name):
        raise ConfigError(f"study.parameters names '{name}'; give a name of letters, digits and _ alone")
    if not isinstance(given, Mapping) or set(given) != {"of", "values"}:
        raise ConfigError(f"{where}={given} is no parameter; give such as {EXAMPLE}")
    paths = [given["of"]] if isinstance(given["of"], str) else given["of"]
    if not isinstance(paths, list) or not paths or not all(isinstance(path, str) for path in paths):
        raise ConfigError(
            f"{where}.of={given['of']} names no settings; give such as descriptor.angles, or a list of such"
        )
    values = given["values"]
    if not isinstance(values, list) or not values or not all(_is_number(value) for value in values):
        raise ConfigError(f"{where}.values={values} are no numbers; give some, such as [1,2,4]")
    if twice := {value for value in values if values.count(value) > 1}:
        raise ConfigError(f"{where}.values has {min(twice):g} more than once; give each value once")
    return Parameter(paths, sorted(values))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def variants_of(parts: Parts, parameters: Mapping[str, Parameter]) -> list[Variant]:
    """A variant for every value of every parameter; ConfigError for settings or values that there are not."""
    return [
        _variant(parts, name, parameter.of, value)
        for name, parameter in parameters.items()
        for value in parameter.values
    ]


def _variant(parts: Parts, name: str, paths: Sequence[str], value: float) -> Variant:
    where = f"study.parameters.{name}"
    new: list[Any] = []
    for path in paths:
        slot, member, names = _split(parts, path, where)
        component = getattr(parts, slot) if member is None else getattr(parts, slot)[member]
        holder = slot if member is None else f"{slot}.{member}"
        made = _with_value(component, names, value, holder, where)
        held: dict[str, Any] = {slot: made if member is None else {**getattr(parts, slot), member: made}}
        parts = replace(parts, **held)
        new.append(None if slot in OF_ALL else made)
    touched = [m for m in methods_of(parts) if any(c is None or c is m.descriptor or c is m.distance for c in new)]
    if not touched:
        raise ConfigError(
            f"{where} changes {', '.join(paths)}, and no method is compared with that; name what is compared"
        )
    return Variant(name, value, parts, touched)


def _split(parts: Parts, path: str, where: str) -> tuple[str, str | None, list[str]]:
    """Slot, member of it (None where it holds one component alone) and names of the setting; ConfigError if it is none."""
    slot, *names = path.split(".")
    filled = [name for name in MEASURED if getattr(parts, name)]
    if slot not in filled:
        kinds = "" if slot in MEASURED or not hasattr(parts, slot) else (
            f"{where} changes {path}, which no measure of this study depends on; sweep it over its own study: omnilab -m ..."
            f" {path}=A,B"
        )  # fmt: skip
        raise ConfigError(
            kinds
            or f"{where} changes '{path}', and the run has no {slot}; there is {', '.join(filled)}"
            f"{did_you_mean(slot, filled)}"
        )
    held = getattr(parts, slot)
    if not isinstance(held, Mapping):
        member = None
    else:
        member = names.pop(0) if names else ""
        if member not in held:
            raise ConfigError(
                f"{where} changes '{path}', and there is no {slot}.{member}; there is {', '.join(held)}"
                f"{did_you_mean(member, held)}"
            )
    if not names:
        raise ConfigError(f"{where} changes '{path}', which is no setting; give one of it, such as {path}.SETTING")
    return slot, member, names


def _with_value(component: Any, names: Sequence[str], value: float, holder: str, where: str) -> Any:
    """A component with a number in place of a setting's; ConfigError if it has no such setting, or it cannot be that."""
    name, *below = names
    known = [f.name for f in fields(component)] if is_dataclass(component) else []
    if name not in known:
        raise ConfigError(
            f"{where} changes '{name}', which is no setting of {holder}; there is {', '.join(known)}"
            f"{did_you_mean(name, known)}"
        )
    if below:
        held = getattr(component, name)
        return replace(component, **{name: _with_value(held, below, value, f"{holder}.{name}", where)})
    cls: Any = type(component)
    numeric = list(numeric_settings(cls))
    if name not in numeric:
        raise ConfigError(
            f"{where} changes {holder}.{name}, which holds no number; of {holder}, these do:"
            f" {', '.join(numeric) or 'none'}"
        )
    number = int(value) if ranges_of(cls)[name].whole and float(value).is_integer() else value
    if wrong := out_of_range(cls, {name: number}, f"{where}: {holder}."):
        raise ConfigError(wrong)
    try:
        return replace(component, **{name: number})
    except ConfigError as error:  # of settings that depend on each other
        raise ConfigError(f"{where} at {value:g}: {error}") from error


def numeric_settings(cls: Any) -> Iterator[str]:
    """The settings of a component that hold one number."""
    hints = get_type_hints(cls)
    for name, allowed in ranges_of(cls).items():
        if not allowed.listed and {int, float} & set(plain_types(hints[name])):
            yield name


def steps_of(values: Sequence[float]) -> list[int]:
    """A step of the logs for each value: the value itself where all are whole, else its number."""
    whole = all(float(value).is_integer() and math.fabs(value) < 2**31 for value in values)
    return [int(value) for value in values] if whole else list(range(len(values)))
