"""What is asked to be run, composed and built without running it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any

from omegaconf import DictConfig

from omnilab.errors import ConfigError, OmnilabError
from omnilab.runner.input_files import leaves
from omnilab.runner.overrides.composition import Composition, check_build, compose, compose_job
from omnilab.runner.overrides.doubts import is_choice
from omnilab.runner.registry import Registry
from omnilab.runner.shards.words import SHARDS, in_shards
from omnilab_serve.composing.composer import SettingError
from omnilab_serve.composing.network import Bounds, check_places, check_words, is_sweep

CHECKED = 12  # jobs of a sweep that are composed and built
MOST_SHARDS = 999


def check(
    registry: Registry,
    overrides: Sequence[str],
    launcher: str,
    logs: str,
    inputs: Sequence[str],
    checked: int = CHECKED,
) -> dict[str, Any]:
    """What overrides come to: experiment, number of jobs, the words of the command, the values that a sweep varies."""
    known = [word.partition("=")[0] for word in overrides]
    bounds = Bounds(logs, inputs)
    shards = [word for word in overrides if word.startswith(f"{SHARDS}=")]
    words = [word for word in overrides if word not in shards]
    try:
        _check_shards(shards)
        experiment = check_words(words, registry, bounds)
    except OmnilabError as error:
        raise SettingError(str(error), setting_of(str(error), known)) from error
    try:
        if shards or is_sweep(words, registry):
            if not re.fullmatch(r"\w+", launcher):
                raise ConfigError(f"launcher={launcher} is no name; give basic, or one that is installed")
            words = ["-m", *words, *([f"hydra/launcher={launcher}"] if launcher != "basic" or shards else [])]
            words = in_shards([*words, *shards], registry, lambda _: None)
        composed = compose(words, registry)
        known += names_of(composed.config)
        for config in _jobs(composed, registry, checked):
            check_places(config, bounds)
            check_build(config, registry)
    except OmnilabError as error:
        found = setting_of(str(error), known) or _choice_of(str(error), overrides, registry)
        raise SettingError(str(error), found) from error
    swept = {name: list(values) for name, values in composed.swept.items()}
    return {"experiment": experiment, "jobs": composed.jobs, "command": words, "swept": swept}


def _check_shards(words: Sequence[str]) -> None:
    """ConfigError for more shards than a page shows, before their names are written out."""
    for word in words:
        number = word.partition("=")[2]
        if number.isdecimal() and int(number[:6]) > MOST_SHARDS:
            raise ConfigError(f"{word} is more than is asked of a service; give {SHARDS}={MOST_SHARDS} or fewer")


def _choice_of(sentence: str, overrides: Sequence[str], registry: Registry) -> str | None:
    """Which choice of a component a sentence is about that names none: the last, if the recipe does not fit it."""
    choices = [word for word in overrides if is_choice(word.partition("=")[0])]
    try:
        compose(choices, registry)
    except OmnilabError as error:
        return choices[-1].partition("=")[0] if str(error) == sentence else None
    return None


def _jobs(composed: Composition, registry: Registry, checked: int) -> Iterable[DictConfig]:
    """The configuration of the first job, and those in which one value is another, up to a number."""
    yield composed.config
    for overrides in composed.varied[: checked - 1]:
        yield compose_job(overrides, registry)[0]


def names_of(config: DictConfig) -> list[str]:
    """The names of all settings of a configuration, and of those that hold them."""
    found = dict.fromkeys(name for name, _ in leaves("", config))
    return list(found | dict.fromkeys(name.rpartition(".")[0] for name in found))


def setting_of(sentence: str, known: Iterable[str]) -> str | None:
    """Which of these settings a sentence is about: the first that it names; the longest, where several begin there."""
    names = {name.lstrip("+~"): name for name in known if name}
    found = [
        (match.start(), -len(name), name)
        for name in names
        if (match := re.search(rf"(?<![\w.@/]){re.escape(name)}(?![\w.@/]*\w)", sentence))
    ]
    if found:
        return min(found)[2]
    dotted = re.match(r"'?([a-z_]+(?:\.\w+)+)", sentence)  # one without a value is no setting of a configuration yet
    return dotted[1] if dotted else None
