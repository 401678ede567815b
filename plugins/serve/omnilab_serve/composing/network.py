"""What words of a command may say when they come over the network: no code, and no place of the disk but those allowed."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydra.core.override_parser.types import ChoiceSweep, Glob, IntervalSweep, Override, QuotedString, RangeSweep
from omegaconf import DictConfig

from omnilab.errors import ConfigError
from omnilab.runner.input_files import inputs_of
from omnilab.runner.overrides.command_line import for_hydra, parse_override
from omnilab.runner.overrides.doubts import OF_HYDRA, PLAIN, doubt, is_choice, written_settings
from omnilab.runner.registry import Registry
from omnilab.runner.storage.urls import is_url, protocol_of, protocols, shown
from omnilab_serve.composing.catalog import check_recipe

MOST_WORDS, LONGEST_WORD, MOST_VALUES, MOST_BRACKETS = 200, 8192, 10_000, 100
RESERVED = {  # words of the command line that are no settings, and what does their work here
    "logs": "runs go to the logs of the service",
    "resume": "a sweep is resumed on its page",
    "retry_failed": "a sweep is resumed on its page",
}


@dataclass(frozen=True)
class Bounds:
    """Where a run may read, and where it may write."""

    logs: str
    inputs: Sequence[str]

    def may_read(self, place: str) -> bool:
        """Whether a place is within the logs, or a folder of inputs, links resolved."""
        return any(_is_within(place, folder) for folder in (self.logs, *self.inputs))

    def readable(self) -> str:
        return ", ".join([*self.inputs, self.logs])


def check_words(words: Sequence[str], registry: Registry, bounds: Bounds) -> str:
    """The one experiment that is named; ConfigError in a sentence about the first word that may not come from elsewhere."""
    if len(words) > MOST_WORDS:
        raise ConfigError(f"there are {len(words)} overrides; give up to {MOST_WORDS}")
    for word in words:
        _check_word(word, registry)
    experiments = [word for word in words if word.partition("=")[0].lstrip("+~").partition("@")[0] == "experiment"]
    if len(experiments) != 1:
        raise ConfigError(f"{len(experiments) or 'no'} experiments are named; give one experiment=NAME")
    name = experiments[0].removeprefix("experiment=")
    check_recipe(name, registry)
    written = written_settings(registry)
    for word in for_hydra(["-m", *words], registry)[1:]:
        if not is_choice(word.partition("=")[0]) and (override := parse_override(word)) is not None:
            for setting, text in texts(override.key_or_group, override.value()):
                _check_text(word, setting, text, written, bounds)
    return name


def is_sweep(words: Sequence[str], registry: Registry) -> bool:
    """Whether one of the words has several values."""
    found = [parse_override(word) for word in for_hydra(["-m", *words], registry)[1:]]
    return any(override is not None and override.is_sweep_override() for override in found)


def check_places(config: DictConfig, bounds: Bounds) -> None:
    """ConfigError if a file that is named beside a folder is a link that leads out of what may be read."""
    for name, place in inputs_of("", config):
        if " below " in name and not bounds.may_read(place):
            raise ConfigError(f"{name.partition(' below ')[0]} leads to {place}, {_outside(bounds)}")


def _check_word(word: str, registry: Registry) -> None:
    key = word.partition("=")[0]
    if len(word) > LONGEST_WORD:
        raise ConfigError(f"{word[:60]}... has {len(word)} characters; give up to {LONGEST_WORD}")
    if sum(map(word.count, "[{(")) > MOST_BRACKETS:
        raise ConfigError(f"{word[:60]}... has more than {MOST_BRACKETS} brackets; give fewer")
    if "\0" in word:
        raise ConfigError(f"{key} holds the character NUL, which no name and no path has; leave it out")
    if word.startswith("-"):
        raise ConfigError(f"{word} is an option, which is not taken from elsewhere; give overrides as NAME=VALUE")
    if "${" in word:
        raise ConfigError(
            f"{word} inserts what ${{...}} names, which is not taken from elsewhere; give the value itself"
        )
    if OF_HYDRA.match(key) and (not PLAIN.fullmatch(word) or "/" in key):
        raise ConfigError(
            f"{word} sets Hydra itself, which is not taken from elsewhere; the launcher is a field of its own"
        )
    if key.lstrip("+~") in RESERVED:
        raise ConfigError(f"{word} is not taken from elsewhere: {RESERVED[key.lstrip('+~')]}; leave it out")
    if (reason := doubt(word, registry)) and is_choice(key):
        raise ConfigError(f"{word} is a path, {reason}; give a name")
    if (override := parse_override(word)) is not None:
        _check_ranges(word, override)


def _check_ranges(word: str, override: Override) -> None:
    """ConfigError for a range that would fill the memory, before it is counted out."""
    value: Any = override.value()
    if isinstance(value, RangeSweep) and value.start is not None and value.stop is not None:
        if not value.step:
            raise ConfigError(f"{word} has steps of 0; give another")
        if abs(value.stop - value.start) / abs(value.step) > MOST_VALUES:
            raise ConfigError(f"{word} has more than {MOST_VALUES} values; give larger steps")
    elif isinstance(value, ChoiceSweep) and len(value.list) > MOST_VALUES:
        raise ConfigError(f"{override.key_or_group} has {len(value.list)} values; give up to {MOST_VALUES}")


def texts(setting: str, value: Any) -> Iterator[tuple[str, str]]:
    """Every text in the value of an override, with the last name of the setting that it is for."""
    if isinstance(value, QuotedString | str):
        yield setting.rpartition(".")[2], value.text if isinstance(value, QuotedString) else value
    elif isinstance(value, Mapping):
        for name, member in value.items():
            yield from texts(name.text if isinstance(name, QuotedString) else str(name), member)
    elif isinstance(value, ChoiceSweep):
        yield from texts(setting, list(value.list))
    elif isinstance(value, list | tuple):
        for member in value:
            yield from texts(setting, member)
    elif not isinstance(value, int | float | None | Glob | IntervalSweep | RangeSweep):  # those hold no path
        raise ConfigError(f"{setting} has a value of a kind that is not taken from elsewhere; give the whole value")


def _check_text(word: str, setting: str, text: str, written: set[str], bounds: Bounds) -> None:
    if is_url(text) and protocol_of(text) in protocols():
        raise ConfigError(
            f"{setting}={shown(text)} would be fetched with the rights of the service, which is not asked of it from elsewhere;"
            f" fetch it into {bounds.readable()}, and give that"
        )
    place = os.path.expanduser(text)  # noqa: PTH111  may name no user
    if setting in written:
        folder = bounds.logs
        inside = str(Path(folder, place)) if setting == "cache" else place
        if text.lower() not in {"null", "off", "false"} and not _is_within(inside, folder):
            where = "a name without .." if setting == "cache" else f"a place below {folder}"
            raise ConfigError(
                f"{word} is written to outside of the logs, which is not taken from elsewhere; give {where}"
            )
        return
    leads_out = Path(place).is_absolute() or ".." in re.split(r"[/\\]", place)
    if (leads_out or os.path.lexists(place)) and not bounds.may_read(place):
        raise ConfigError(f"{word} is read from {os.path.realpath(place)}, {_outside(bounds)}")


def _outside(bounds: Bounds) -> str:
    return f"which is in none of the folders that runs may read here ({bounds.readable()}); start the service with --inputs DIR for another"


def _is_within(place: str, folder: str) -> bool:
    try:
        real, root = os.path.realpath(place), os.path.realpath(folder)
    except (OSError, ValueError):  # a zero byte, a circle of links
        return False
    return os.path.commonpath([real, root]) == root
