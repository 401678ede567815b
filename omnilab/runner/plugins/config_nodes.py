"""Components as Hydra finds them: nodes of its ConfigStore, each made when a configuration takes it."""

from __future__ import annotations

from functools import cache
from typing import Any

from hydra.core.config_store import ConfigNode, ConfigStore
from omegaconf import DictConfig, OmegaConf

from omnilab.runner.registry import MANY, Component, Registry


@cache
def node_of(cls: type[Any]) -> DictConfig:
    """A component's class as a node of the configuration."""
    made: DictConfig = OmegaConf.structured(cls)
    return made


class ComponentNode(ConfigNode):
    """A component under one of its names; to make the nodes of all there are takes longer than to import them."""

    def __init__(self, name: str, component: Component) -> None:
        self.name, self.group, self.provider = f"{name}.yaml", component.kind, component.plugin.distribution
        self.package = f"{MANY[component.kind]}.{name}" if component.kind in MANY else component.kind
        self.cls = component.cls

    @property
    def node(self) -> DictConfig:  # type: ignore[override]
        return node_of(self.cls)  # type: ignore[arg-type]  # a class is hashable

    def __copy__(self) -> ConfigNode:
        """An ordinary one, into which `ConfigStore.load` puts a copy of the node."""
        return ConfigNode(self.name, self.node, self.group, self.package, self.provider)


def store_components(registry: Registry) -> None:
    """Put all components where Hydra finds them."""
    store = ConfigStore.instance()
    vars(store)["__deepcopy__"] = _uncopied
    for component in registry.components.values():
        group = store.repo.setdefault(component.kind, {})
        for name in filter(None, (component.name, component.formerly)):
            node = ComponentNode(name, component)
            group[node.name] = node


def _uncopied(_: object) -> ConfigStore:
    """The store instead of a copy of all of it, two of which Hydra makes a start; it copies each node that it takes."""
    return ConfigStore.instance()
