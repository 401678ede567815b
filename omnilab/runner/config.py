"""The configuration of a run: one typed tree, a slot or a dictionary for each kind of component."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, is_dataclass
from typing import Any

from hydra.core.config_store import ConfigStore
from omegaconf import MISSING, DictConfig, OmegaConf

from omnilab.api import KINDS
from omnilab.runner.registry import DICTS, Registry

log = logging.getLogger("omnilab")


@dataclass
class Run:
    """The whole configuration of one run. A slot holds a component, or null where the study needs none."""

    sensor: Any = None
    descriptor: Any = None
    distance: Any = None  # null: the descriptor's default distance
    localizer: Any = None
    altimeter: Any = None
    odometry: Any = None
    loop_closure: Any = None
    backend: Any = None
    view_filter: Any = None
    study: Any = MISSING
    descriptors: dict[str, Any] = field(default_factory=dict)  # that a study compares
    distances: dict[str, Any] = field(default_factory=dict)  # that a study compares them with
    localizers: dict[str, Any] = field(default_factory=dict)  # that a study compares
    altimeters: dict[str, Any] = field(default_factory=dict)  # that a study compares
    odometries: dict[str, Any] = field(default_factory=dict)  # that join the run's own
    backends: dict[str, Any] = field(default_factory=dict)  # that a study compares
    view_filters: dict[str, Any] = field(default_factory=dict)  # that a study compares
    sensors: dict[str, Any] = field(default_factory=dict)  # that a study uses beside the run's own
    disturbances: dict[str, Any] = field(default_factory=dict)  # of the queries, in the order they apply
    sinks: dict[str, Any] = field(default_factory=dict)
    map: str | None = None  # a map that another run saved, or that run's folder; it brings its descriptor and distance
    seed: int = 0
    threads: int = 1  # of each matrix product: results are only the same bit for bit with the same number
    logs: str = "logs"  # where run folders go
    cache: str | None = "cache"  # folder of descriptions, within `logs` unless absolute; off: describe everything anew
    cache_gb: float = 4.0  # at most; then those go that were used longest ago


ConfigStore.instance().store(name="omnilab_run", node=Run, provider="omnilab")


def structured(config: DictConfig) -> Iterator[tuple[str, DictConfig]]:
    """The run and each of its components, with the path before their settings."""
    yield "", config
    for path, _, value in components_of({str(k): config[k] for k in config if not OmegaConf.is_missing(config, k)}):
        if isinstance(value, DictConfig) and is_dataclass(OmegaConf.get_type(value)):
            yield f"{path}.", value


def components_of(settings: Mapping[str, Any]) -> Iterator[tuple[str, str, Any]]:
    """Path, kind and content of every slot of a run's settings, and of every member of its dicts of components."""
    for name, value in settings.items():
        if name in KINDS:
            yield name, name, value
        elif name in DICTS:
            for key, member in value.items():
                yield f"{name}.{key}", DICTS[name], member


def named_components(run: Run, registry: Registry) -> dict[str, dict[str, str]]:
    """For each slot in use: the registered name, class, distribution and version."""
    found: dict[str, dict[str, str]] = {}
    for slot, _, value in components_of(vars(run)):
        if value is None:
            continue
        component = registry.of(value)
        found[slot] = {
            "name": component.name if component else "",
            "class": f"{type(value).__module__}.{type(value).__qualname__}",
            "distribution": component.plugin.distribution if component else "",
            "version": component.plugin.version if component else "",
        }
    return found


def resolved_yaml(run: Run) -> str:
    """The configuration as it ran, defaults and all."""
    return OmegaConf.to_yaml(resolved(run))


def resolved(run: Run) -> DictConfig:
    return OmegaConf.create({name: _settings(value) for name, value in vars(run).items()})


def _settings(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _settings(member) for name, member in value.items()}
    return OmegaConf.structured(value) if is_dataclass(value) else value
