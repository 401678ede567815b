"""What is installed: recipes, components with their settings, plugins that failed, launchers."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from omnilab.api import KINDS
from omnilab.client import ComponentRecord
from omnilab.errors import ConfigError, did_you_mean
from omnilab.runner.config import Settings
from omnilab.runner.manual import settings_data
from omnilab.runner.overrides.composition import launchers
from omnilab.runner.plugins.folders import comment_of
from omnilab.runner.registry import Component, Registry
from omnilab_serve.composing.pictures import worlds_of


def catalog(registry: Registry) -> dict[str, Any]:
    """All of it, as JSON."""
    return {
        "recipes": [described(name, registry) for name in sorted(registry.recipes)],
        "kinds": {kind.name: kind.summary for kind in KINDS.values()},
        "components": [asdict(record(component)) for component in registry.components.values()],
        "run": settings(Settings),
        "worlds": {each.name: worlds for each in registry.components.values() if (worlds := pictured(each))},
        "failures": [
            {"plugin": each.plugin.title, "sentence": each.sentence, "traceback": each.traceback}
            for each in registry.failures
        ],
        "launchers": launchers(),
    }


def pictured(component: Component) -> list[str]:
    """The worlds of which a component can have pictures as it is."""
    needs = any(setting["required"] for setting in settings(component.cls))
    return worlds_of(component.cls) if component.kind == "sensor" and not needs else []


def check_recipe(name: str, registry: Registry) -> None:
    """ConfigError if neither omnilab nor a plugin ships an experiment of that name."""
    if name not in (known := sorted(registry.recipes)):
        raise ConfigError(
            f"experiment '{name}' does not exist; there is {', '.join(known)}"
            f"{did_you_mean(name, known, 'experiment=')}{registry.failed}"
        )


def described(recipe: str, registry: Registry) -> dict[str, str]:
    """A recipe's name, the first line of its comment, and the further ones."""
    summary, notes = comment_of(registry.recipes[recipe].file)
    return {"name": recipe, "summary": summary, "notes": notes}


def record(component: Component) -> ComponentRecord:
    """A component with its manual and settings."""
    return ComponentRecord(
        component.kind,
        component.name,
        component.summary,
        inspect.cleandoc(component.cls.__doc__ or ""),
        component.plugin.distribution,
        component.plugin.version,
        settings(component.cls),
    )


_SETTINGS: dict[type[Any], Sequence[Mapping[str, Any]]] = {}


def settings(cls: type[Any]) -> Sequence[Mapping[str, Any]]:
    """The settings of a component, read from its source once; none where that cannot be read."""
    if cls not in _SETTINGS:
        try:
            _SETTINGS[cls] = settings_data(cls)
        except (OSError, TypeError):  # the class was made without a file
            _SETTINGS[cls] = []
    return _SETTINGS[cls]
