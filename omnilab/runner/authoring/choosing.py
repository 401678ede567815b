"""Which component a command means by its words, with its settings and those beside it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from omnilab.api import KINDS, Parts
from omnilab.errors import ConfigError, DataError, did_you_mean
from omnilab.runner.build import components
from omnilab.runner.config import Run
from omnilab.runner.overrides.command_line import parse_override
from omnilab.runner.overrides.composition import compose, in_sentences
from omnilab.runner.plugin_files import VARIABLE
from omnilab.runner.plugins.finding import missing_distributions
from omnilab.runner.registry import DICTS, MANY, Component, Registry
from omnilab.testing.by_kind import TRIALS
from omnilab.testing.descriptor import DescriptorTrial
from omnilab.testing.distance import DistanceTrial
from omnilab.testing.loop_closure import LoopClosureTrial
from omnilab.testing.odometry import OdometryTrial
from omnilab.testing.parts import frames_of, study_parts
from omnilab.testing.rules import Trial
from omnilab.testing.study import StudyTrial

OF_EVERY_RUN = ("console", "rerun", "mcap")  # sinks that the configuration begins with
BESIDE = {"distance": "descriptor", "odometry": "sensor", "loop_closure": "sensor"}  # what a kind may be checked with


@dataclass(frozen=True)
class Chosen:
    """A component with its settings, and what tries it."""

    component: Component
    trial: Trial


def add_file(file: Path) -> None:
    """Have a plugin's file among those that are discovered."""
    words = [os.environ[VARIABLE]] if os.environ.get(VARIABLE) else []
    os.environ[VARIABLE] = ",".join([*words, str(file)])


def of_file(file: Path, registry: Registry) -> list[Component]:
    """The components that a plugin's file registers; DataError if it could not be loaded, or has none."""
    same = [f for f in registry.failures if f.plugin.word and Path(f.plugin.word).absolute() == file.absolute()]
    if same:
        raise DataError(f"{same[0].sentence} (omnilab plugins -v shows the traceback, with {VARIABLE}={file})")
    found = [
        c for c in registry.components.values() if c.plugin.word and Path(c.plugin.word).absolute() == file.absolute()
    ]
    if not found:
        raise DataError(f"{file} registers commands alone, and only components are checked; look at it by hand")
    return found


def named(word: str, registry: Registry) -> Component:
    """The component that a word means, KIND=NAME or NAME; ConfigError if there is none, or several."""
    kind, equals, name = word.partition("=")
    if equals:
        if kind not in KINDS:
            raise ConfigError(f"'{kind}' is no kind; there is {', '.join(KINDS)}{did_you_mean(kind, KINDS)}")
        if found := registry.find(kind, name):
            return found
        raise ConfigError(registry.missing(kind, name) + _not_installed())
    several = [c for c in registry.components.values() if word in {c.name, c.formerly}]
    if len(several) > 1:
        ways = " or ".join(f"{c.kind}={c.name}" for c in several)
        raise ConfigError(f"'{word}' is the name of {len(several)} components; give {ways}")
    if not several:
        known = sorted({c.name for c in registry.components.values()})
        raise ConfigError(
            f"there is no component '{word}', and no such file or folder{did_you_mean(word, known)}; omnilab plugins"
            f" lists those that there are{registry.failed}{_not_installed()}"
        )
    return several[0]


def _not_installed() -> str:
    """For the end of a sentence: the distributions of omnilab[all] that may have it."""
    names = missing_distributions()
    extras = ",".join(name.removeprefix("omnilab-") for name in names)
    return f"; not installed: {', '.join(names)} (pip install 'omnilab[{extras}]')" if names else ""


def chosen(component: Component, words: Sequence[str], registry: Registry) -> Chosen:
    """A component with what further words say of it; ConfigError if they say what cannot be."""
    kind, place = component.kind, MANY.get(component.kind)
    for word in words:
        _check_word(word, component)
    beside = [word for word in words if word.partition("=")[0] in KINDS]
    ours = [] if kind == "sink" and component.name in OF_EVERY_RUN else [_choice(component)]
    dropped = [f"~sink@sinks.{name}" for name in OF_EVERY_RUN if kind != "sink" or name != component.name]
    recipe = any(word.startswith("experiment=") for word in words)
    composed = compose([*ours, *words, *([] if recipe else ["~experiment"]), *dropped], registry).config
    with in_sentences(registry, words):
        run = components(composed, registry)
    instance = getattr(run, place)[component.name] if place else getattr(run, kind)
    return Chosen(component, _trial(kind, instance, run, bool(beside) or recipe))


def _choice(component: Component) -> str:
    if component.kind == "sink":
        return f"+sink@sinks.{component.name}={component.name}"
    return f"{component.kind}={component.name}"


def _check_word(word: str, component: Component) -> None:
    """ConfigError for a word that a check has no use for."""
    key = word.lstrip("+~").partition("=")[0].partition("@")[0]
    parsed = parse_override(word)
    if parsed is not None and parsed.is_sweep_override():
        raise ConfigError(f"{word} is several values, and one component is checked at a time; give one of them")
    head, kind = key.partition(".")[0], component.kind
    own = {kind, KINDS[kind].plural}
    if kind == "study":
        own |= {*KINDS, *DICTS, "experiment", "map"}
    elif kind in BESIDE:
        own.add(BESIDE[kind])
    if head not in own:
        setting = f"{MANY[kind]}.{component.name}" if kind in MANY else kind
        raise ConfigError(
            f"'{word}' says nothing of {kind}={component.name}; its settings are given as {setting}.NAME=VALUE"
            + (f", and a {BESIDE[kind]} that it is checked with as {BESIDE[kind]}=NAME" if kind in BESIDE else "")
        )


def _trial(kind: str, instance: Any, run: Run, beside: bool) -> Trial:
    """What tries a component: with what was chosen beside it, and otherwise what the conformance checks show."""
    if kind == "distance" and beside and run.descriptor is not None:
        described = DescriptorTrial(run.descriptor)
        return DistanceTrial(instance, described.first, run.descriptor.rotation == "equivariant")
    if kind == "odometry" and beside and run.sensor is not None:
        return OdometryTrial(instance, frames_of(run.sensor))
    if kind == "loop_closure" and beside and run.sensor is not None:
        return LoopClosureTrial(instance, frames_of(run.sensor))
    if kind == "study" and beside:
        names = [f.name for f in fields(Parts) if f.name not in {"map", "default_distances", "shards"}]
        given = {name: value for name in names if (value := getattr(run, name)) not in (None, {})}
        return StudyTrial(instance, replace(study_parts(tuple(set(instance.needs) - set(given))), **given))
    return TRIALS[kind](instance)
