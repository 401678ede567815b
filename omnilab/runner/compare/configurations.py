"""What differs between the configurations of runs: settings, components with their versions, contents of files."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from omnilab.runner.run_folder.reading import safe_yaml

BESIDE = {
    "seed",
    "logs",
    "cache",
    "cache_gb",
    "limits",
    "objective",
    "sinks",
}  # sections that change no result, and the seed
SECTION = re.compile(r"^(?=[^\s\-#])", re.MULTILINE)
NAME = re.compile(r"([A-Za-z_]\w*):(?:\s|$)")
DIGEST_DIGITS = 8  # of a file's content that are shown

Column = list[str | None]  # a setting's value of each run, as an override would say it; None of a run without it
Settings = dict[str, str]  # by path


@dataclass(frozen=True)
class Configuration:
    """What a run was made of."""

    sections: Mapping[str, Settings]  # of config.yaml: each slot, and each setting beside them
    components: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # of the manifest, by slot
    files: Mapping[str, Any] = field(default_factory=dict)  # digests of what was read, by setting
    overrides: Sequence[str] = ()


class SectionReader:
    """Reads configurations section by section, each text once: ten thousand jobs of a sweep share nearly all of theirs."""

    def __init__(self) -> None:
        self._read: dict[str, tuple[str, Settings]] = {}

    def read(self, text: str) -> dict[str, Settings]:
        """The settings of a config.yaml by the names at its top; ValueError if it is no such YAML."""
        return dict(self._section(part) for part in SECTION.split(text) if part.strip())

    def _section(self, text: str) -> tuple[str, Settings]:
        """A name at the top, and the settings below it."""
        if text not in self._read:
            content, name = safe_yaml(text), NAME.match(text)
            if name is None or not isinstance(content, dict) or list(content) != [name[1]]:
                raise ValueError(f"'{text[:20]}' begins no setting")
            self._read[text] = name[1], dict(_flat(name[1], content[name[1]]))
        return self._read[text]


def differences(configurations: Sequence[Configuration]) -> dict[str, Column]:
    """The settings in which configurations differ, by their path, and of each its value in every one of them.

    A slot's value is the registered name of its component, with its distribution's version where those differ. A file is
    the same if its content is. Left out: what changes no result (sinks, folders), the seed, and settings that another
    component brings with it, but for those that an override names.
    """
    slots = {slot: column for slot, column in _components(configurations).items() if len(set(column)) > 1}
    named = {slot for configuration in configurations for slot in configuration.components}
    overridden = {
        _path_of(override) for configuration in configurations for override in configuration.overrides if slots
    }
    found = dict(slots)
    for path, column in _settings(configurations).items():
        column = _with_digests(column, [configuration.files.get(path) for configuration in configurations])  # noqa: PLW2901
        slot = _slot_of(path, slots)
        brought = slot is not None and path not in overridden and _follows(column, slots[slot])
        if len(set(column)) > 1 and path not in named and not brought:
            found[path] = column
    return found


def _path_of(override: str) -> str:
    """The setting that an override names."""
    return override.partition("=")[0].lstrip("+~")


def _components(configurations: Sequence[Configuration]) -> dict[str, Column]:
    """The components of every slot."""
    slots = dict.fromkeys(s for configuration in configurations for s in configuration.components if _counts(s))
    return {slot: _named([configuration.components.get(slot) for configuration in configurations]) for slot in slots}


def _counts(path: str) -> bool:
    return path.partition(".")[0] not in BESIDE


def _named(components: Sequence[Mapping[str, Any] | None]) -> Column:
    """Components by their names; with distribution and version where one name stands for several."""
    names = [None if c is None else str(c.get("name") or c.get("class")) for c in components]
    full = [
        None if c is None else f"{name} ({c.get('distribution')} {c.get('version')})"
        for name, c in zip(names, components, strict=True)
    ]
    return names if _follows(full, names) else full


def _settings(configurations: Sequence[Configuration]) -> dict[str, Column]:
    """All settings in sections that differ, or name files that do."""
    found: dict[str, Column] = {}
    nothing: Settings = {}
    read = {
        (path, digest)
        for configuration in configurations
        for path, digest in configuration.files.items()
        if isinstance(digest, str)
    }
    several = {path.partition(".")[0] for path, count in Counter(path for path, _ in read).items() if count > 1}
    for name in dict.fromkeys(name for configuration in configurations for name in configuration.sections):
        settings = [configuration.sections.get(name, nothing) for configuration in configurations]
        distinct = {id(one): one for one in settings}  # those of one text are one
        if name not in BESIDE and (len(distinct) > 1 or name in several):
            for path in dict.fromkeys(path for one in distinct.values() for path in one):
                found[path] = [one.get(path) for one in settings]
    return found


def _flat(path: str, value: Any) -> Iterable[tuple[str, str]]:
    """Paths and values, as overrides would say them."""
    if isinstance(value, dict):
        for name, member in value.items():
            yield from _flat(f"{path}.{name}", member)
    else:
        yield path, value if isinstance(value, str) else json.dumps(value, ensure_ascii=False, default=str)


def _slot_of(path: str, slots: Iterable[str]) -> str | None:
    """The slot among these whose component a setting belongs to."""
    return next((slot for slot in slots if path.startswith(f"{slot}.")), None)


def _follows(column: Sequence[Any], other: Sequence[Any]) -> bool:
    """Whether what a run has in one column is known from what it has in the other."""
    return len(set(zip(other, column, strict=True))) == len(set(other))


def _with_digests(column: Column, digests: Sequence[Any]) -> Column:
    """Names of files: one and the same if all contents are; each with its digest where a name has several contents."""
    texts = [digest if isinstance(digest, str) else None for digest in digests]
    if None not in texts and len(set(texts)) == 1:
        return column[:1] * len(column)
    if _follows(texts, column):
        return column
    return [
        f"{name} (sha256 {(digest or 'unknown')[:DIGEST_DIGITS]})" for name, digest in zip(column, texts, strict=True)
    ]
