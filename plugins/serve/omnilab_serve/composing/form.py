"""A form for an experiment: what fills its slots, what else could, and every setting with its value."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

from omegaconf import DictConfig, OmegaConf, open_dict

from omnilab.api import KINDS, setting
from omnilab.errors import ConfigError
from omnilab.runner.config import Settings, components_of
from omnilab.runner.overrides.command_line import quoted
from omnilab.runner.overrides.composition import compose
from omnilab.runner.registry import MANY, Component, Registry
from omnilab.runner.shards.shard import stages_of
from omnilab_serve.composing.catalog import check_recipe, described, settings
from omnilab_serve.composing.checking import MOST_SHARDS
from omnilab_serve.composing.pictures import worlds_of

HIDDEN = {
    "logs",
    "objective",
    "shard",
}  # settings of the run that the form leaves to its free overrides, or to the service


@dataclass
class Splitting:
    """What a study that can be split takes beside its settings."""

    shards: int | None = setting(
        None, at_least=1, at_most=MOST_SHARDS
    )  # jobs for each stage, as a sweep; null: one run


def form(registry: Registry, experiment: str, choices: Sequence[str] = ()) -> dict[str, Any]:
    """The slots of an experiment with other components in some of them; `wrong` is the sentence if these do not fit."""
    check_recipe(experiment, registry)
    recipe = compose([f"experiment={experiment}"], registry).config
    try:
        config, wrong = compose([f"experiment={experiment}", *choices], registry).config, None
    except ConfigError as error:  # the recipe sets what another component does not have
        config, wrong = _with(choices, recipe, registry), str(error)
    needs = list(getattr(OmegaConf.get_type(config.study), "needs", ()))
    slots = [_slot(path, kind, value, recipe, registry) for path, kind, value in _slots(config)]
    order = ["study", *needs]
    slots.sort(key=lambda slot: (not slot["name"], order.index(slot["path"]) if slot["path"] in order else len(order)))
    return {
        **described(experiment, registry),
        "slots": slots,
        "run": [_setting(each, each["name"], config) for each in settings(Settings) if each["name"] not in HIDDEN],
        "wrong": wrong,
    }


def _with(choices: Sequence[str], recipe: DictConfig, registry: Registry) -> DictConfig:
    """A recipe with other components as they are by default."""
    changed = recipe.copy()
    for word in choices:
        choice, _, name = word.lstrip("~").partition("=")
        kind, _, place = choice.partition("@")
        found = registry.find(kind, name)
        with open_dict(changed):
            OmegaConf.update(changed, place or kind, OmegaConf.structured(found.cls) if found else None, merge=False)
    return changed


def _slots(config: DictConfig) -> Iterator[tuple[str, str, Any]]:
    """Path, kind and content of the slots that a form shows: all of a run, and the members of its dictionaries."""
    found = {str(name): None if OmegaConf.is_missing(config, name) else config[name] for name in config}
    yield from components_of(found)


def _slot(path: str, kind: str, value: Any, recipe: DictConfig, registry: Registry) -> dict[str, Any]:
    component = _component(kind, value, registry)
    before = _component(kind, OmegaConf.select(recipe, path), registry)
    declared = settings(component.cls) if component else ()
    choice = path if path == kind else None if kind in MANY else f"{kind}@{path}"  # what an override chooses it by
    return {
        "path": path,
        "kind": kind,
        "choice": choice,
        "name": component.name if component else None,
        "recipe": before.name if before else None,
        "summary": component.summary if component else KINDS[kind].summary,
        "names": {name: registry.get(kind, name).summary for name in registry.names(kind)},
        "settings": [_setting(each, f"{path}.{each['name']}", value) for each in declared] + _splitting(component),
    }


def _splitting(component: Component | None) -> list[dict[str, Any]]:
    """The word `shards=N` as a setting, beside those of a study that can be split."""
    if component is None or not stages_of(component.cls):
        return []
    return [_setting(each, each["name"], OmegaConf.structured(Splitting)) for each in settings(Splitting)]


def _component(kind: str, value: Any, registry: Registry) -> Component | None:
    cls = OmegaConf.get_type(value) if isinstance(value, DictConfig) else None
    return next((c for c in registry.components.values() if c.kind == kind and c.cls is cls), None)


def _setting(declared: Mapping[str, Any], path: str, owner: Any) -> dict[str, Any]:
    """A setting with its value as an override would give it; "" where it has none yet."""
    name = declared["name"]
    missing = OmegaConf.is_missing(owner, name)
    value = None if missing else owner[name]
    found = {**declared, "path": path, "value": "" if missing else as_override(value)}
    found["default"] = "" if declared["required"] else as_override(declared["default"])
    if name == "world" and (worlds := worlds_of(OmegaConf.get_type(owner))):
        found["suggestions"] = worlds
    if "settings" in declared:
        found["settings"] = [_setting(each, f"{path}.{each['name']}", value) for each in declared["settings"]]
    return found


def as_override(value: Any) -> str:
    """A value as it is written behind the = of an override."""
    if OmegaConf.is_config(value):
        value = OmegaConf.to_container(value, resolve=False)
    if value is None:
        return "null"
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, bool | int | float):
        return json.dumps(value)
    if isinstance(value, list):
        return f"[{','.join(map(_member, value))}]"
    if isinstance(value, dict):
        return f"{{{','.join(f'{name}:{_member(each)}' for name, each in value.items())}}}"
    return str(value)


def _member(value: Any) -> str:
    return as_override(value) if not isinstance(value, str) or re.fullmatch(r"[\w.-]+", value) else quoted(value)
