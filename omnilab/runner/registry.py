"""Finds plugins, checks what they register, and puts it into Hydra's ConfigStore.

Plugins are loaded one by one, each with a manager of its own: a broken one becomes a `Failure` and never stops the
others. The environment variable ``OMNILAB_PLUGINS`` is a comma-separated list: a path ``file.py`` loads that file
besides the installed plugins, ``-name`` leaves an installed plugin out, ``none`` leaves them all out.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import re
import sys
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, entry_points, requires
from pathlib import Path
from types import ModuleType
from typing import Any

import pluggy
from hydra.core.config_store import ConfigStore
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from omnilab import hooks, renamed
from omnilab.api import KINDS
from omnilab.errors import ConfigError, PluginError, did_you_mean
from omnilab.hooks import COMMANDS_HOOK
from omnilab.runner.repair import RunsOnDisk

DICTS = {kind.plural: kind.name for kind in KINDS.values() if kind.many}  # settings of a run that hold any number
MANY = {kind.name: kind.plural for kind in KINDS.values() if not kind.slot}  # `disturbance=blur` goes to the dict
HOOKS = {kind.name: kind.hook for kind in KINDS.values()}


@dataclass(frozen=True)
class Plugin:
    """Where components come from."""

    name: str
    distribution: str
    version: str
    load: Callable[[], ModuleType] = field(compare=False)

    @property
    def title(self) -> str:
        return f"plugin '{self.name}' ({self.distribution} {self.version})".replace(" )", ")")


@dataclass(frozen=True)
class Component:
    """One registered class."""

    kind: str
    name: str
    cls: type[Any]
    plugin: Plugin
    formerly: str = ""  # the name that it had in the version before

    @property
    def summary(self) -> str:
        """The first line of the manual."""
        return (self.cls.__doc__ or "(no docstring)").strip().partition("\n")[0]


@dataclass(frozen=True)
class Failure:
    """A plugin that could not be used, and why."""

    plugin: Plugin
    error: Exception | SystemExit

    @property
    def sentence(self) -> str:
        cause = f"{type(self.error).__name__}: {self.error}" if not isinstance(self.error, PluginError) else self.error
        return f"{self.plugin.title} not loaded: {' '.join(str(cause).split())}"

    @property
    def traceback(self) -> str:
        return "".join(traceback.format_exception(self.error))


@dataclass
class Registry:
    """All components there are, and the plugins that failed."""

    components: dict[tuple[str, str], Component] = field(default_factory=dict)
    commands: dict[str, hooks.Command] = field(default_factory=dict)
    failures: list[Failure] = field(default_factory=list)
    formerly: dict[tuple[str, str], str] = field(default_factory=dict)  # kind and old name: what it is called now
    notes: list[str] = field(default_factory=list)  # on plugins with words of the version before

    def names(self, kind: str) -> list[str]:
        return sorted(name for k, name in self.components if k == kind)

    def get(self, kind: str, name: str) -> Component:
        """The component of that kind and name; ConfigError with a suggestion if there is none."""
        if found := self.find(kind, name):
            return found
        raise ConfigError(self.missing(kind, name))

    def find(self, kind: str, name: str) -> Component | None:
        """The component of that kind and name, which may be one of the version before; None if there is none."""
        return self.components.get((kind, self.new_name(kind, name) or name))

    def new_name(self, kind: str, name: str) -> str | None:
        """What a component of the version before is called now; None for a name that a component has today."""
        return None if (kind, name) in self.components else self.formerly.get((kind, name))

    def missing(self, kind: str, name: str) -> str:
        """The sentence about a name that does not exist."""
        names = self.names(kind)
        sentence = f"{kind} '{name}' does not exist; there is {', '.join(names) or 'none'}"
        sentence += did_you_mean(name, names, f"{kind}=")
        if self.failures:
            sentence += f"; {len(self.failures)} plugin(s) failed to load, see: omnilab plugins -v"
        return sentence

    def of(self, instance: Any) -> Component | None:
        """Under which name an instance's class is registered."""
        return next((c for c in self.components.values() if c.cls is type(instance)), None)


def discover(select: str | None = None) -> Registry:
    """Load every plugin, register what is sound, and store it for Hydra."""
    chosen = os.environ.get("OMNILAB_PLUGINS", "") if select is None else select
    registry = Registry()
    for plugin in _plugins([word.strip() for word in chosen.split(",") if word.strip()]):
        try:
            components, commands = _load(plugin, registry)
            for component in components:
                _check_free(component, registry)
            for name in commands:
                _check_free_command(name, plugin, registry)
            for component in components:
                _store(component)
        except (Exception, SystemExit) as error:  # noqa: BLE001  what a plugin does wrong must not stop the others
            registry.failures.append(Failure(plugin, error))
        else:
            registry.components.update({(c.kind, c.name): c for c in components})
            registry.formerly.update({(c.kind, c.formerly): c.name for c in components if c.formerly})
            registry.commands.update(commands)
    return registry


def _plugins(chosen: list[str]) -> Iterator[Plugin]:
    """Installed plugins, those of omnilab[all] first so that no other can take their names; then single files."""
    own = _own_distributions()
    found = []
    for point in entry_points(group="omnilab"):
        dist = point.dist
        found.append(Plugin(point.name, dist.name if dist else "?", dist.version if dist else "", point.load))
    found.sort(key=lambda p: (p.distribution not in own, p.distribution, p.name))
    for word in chosen:
        if word != "none" and not word.endswith(".py") and word.removeprefix("-") not in [p.name for p in found]:
            raise ConfigError(
                f"OMNILAB_PLUGINS names '{word}', which is no plugin; give file.py, none, or - and one of "
                + ", ".join(p.name for p in found)
            )
    for plugin in found:
        if "none" not in chosen and f"-{plugin.name}" not in chosen:
            yield plugin
    for path in (word for word in chosen if word.endswith(".py")):
        yield Plugin(Path(path).stem, path, "", lambda path=path: _load_file(Path(path)))  # type: ignore[misc]


def _own_distributions() -> set[str]:
    try:
        wanted = requires("omnilab") or []
    except PackageNotFoundError:  # run from a source tree that was never installed
        return set()
    return {"omnilab"} | {re.split(r"[ ;<>=!~\[]", line)[0] for line in wanted if line.startswith("omnilab-")}


def _load_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise PluginError(f"there is no file {path}; correct the path in OMNILAB_PLUGINS")
    digest = hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:8]  # two files may have the same name
    spec = importlib.util.spec_from_file_location(f"omnilab_file_{path.stem}_{digest}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses and pickles look the module up by its name
    spec.loader.exec_module(module)
    return module


def _load(plugin: Plugin, registry: Registry) -> tuple[list[Component], dict[str, hooks.Command]]:
    """The components and the commands that one plugin registers, each checked."""
    manager = pluggy.PluginManager("omnilab")
    manager.add_hookspecs(hooks.hookspecs())
    manager.register(plugin.load(), name=plugin.name)
    try:
        manager.check_pending()
    except pluggy.PluginValidationError as error:
        raise PluginError(f"{error}; the hooks are {', '.join([*HOOKS.values(), COMMANDS_HOOK])}") from error
    components: dict[tuple[str, str], Component] = {}
    for kind, hook in HOOKS.items():

        def register(name: str, cls: type[Any], formerly: str = "", kind: str = kind) -> None:
            if note := check_component(kind, name, cls):
                registry.notes.append(f"{plugin.title}: {note}")
            if (kind, name) in components:
                raise PluginError(f"{kind} '{name}' is registered twice, by {components[kind, name].cls} and {cls}")
            components[kind, name] = Component(kind, name, cls, plugin, formerly)

        getattr(manager.hook, hook)(register=register)
    commands: dict[str, hooks.Command] = {}

    def register_command(name: str, command: Any) -> None:
        if not re.fullmatch(r"[a-z]+", name) or not callable(command) or name in commands:
            raise PluginError(
                f"command {name!r} is {command!r}; register one function for a name of lower case letters"
            )
        commands[name] = command

    manager.hook.register_commands(register=register_command, runs=RunsOnDisk(registry))
    if not components and not commands:
        raise PluginError(
            "it registers nothing; mark a function with @hookimpl, one of "
            + ", ".join([*HOOKS.values(), COMMANDS_HOOK])
        )
    return list(components.values()), commands


def check_component(kind: str, name: str, cls: type[Any]) -> str:
    """PluginError if a class cannot serve as a component of that kind under that name.

    Returns what to write instead of a word of the version before, or "".
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise PluginError(f"{kind} '{name}' has an unusable name; use lower case letters, digits and _")
    if "__dataclass_fields__" not in getattr(cls, "__dict__", {}):  # neither an instance nor a class that inherits them
        raise PluginError(f"{kind} '{name}' is {cls!r}; register a class with @dataclass")
    note = renamed.adapt(kind, name, cls)
    lacking = [member for member in members(KINDS[kind].protocol) if not hasattr(cls, member)]
    if lacking:
        raise PluginError(
            f"{kind} '{name}' ({cls.__name__}) lacks {', '.join(lacking)}{renamed.hint(cls, lacking)}; see {KINDS[kind].protocol.__name__} in omnilab.api"
        )
    if cls.__dataclass_params__.frozen:
        raise PluginError(f"{kind} '{name}' ({cls.__name__}) is frozen, so nothing could be overridden; use @dataclass")
    try:
        _node(cls)
    except OmegaConfBaseException as error:
        raise PluginError(
            f"{kind} '{name}' ({cls.__name__}): {str(error).splitlines()[0]} (field '{error.full_key}'); use bool, int,"
            " float, str, Path, Enum, list, dict, X | None or a nested dataclass"
        ) from error
    return note


_NODES: dict[type[Any], DictConfig] = {}


def _node(cls: type[Any]) -> DictConfig:
    """A component's class as a node of the configuration; made once, for it takes half of the time of a start."""
    if cls not in _NODES:
        _NODES[cls] = OmegaConf.structured(cls)
    return _NODES[cls]


def members(protocol: type[Any]) -> list[str]:
    """The attributes and methods that a Protocol asks for, those of the Protocols it extends first."""
    found: list[str] = []
    for cls in reversed(protocol.__mro__):
        if getattr(cls, "_is_protocol", False):
            offered = [n for n, value in vars(cls).items() if callable(value) or isinstance(value, property)]
            found += [name for name in [*cls.__annotations__, *offered] if not name.startswith("_")]
    return list(dict.fromkeys(found))


def _check_free(component: Component, registry: Registry) -> None:
    if other := registry.components.get((component.kind, component.name)):
        raise PluginError(
            f"{component.kind} '{component.name}' is registered already by {other.plugin.title};"
            f" rename it, or leave one plugin out with OMNILAB_PLUGINS=-{component.plugin.name}"
        )


def _check_free_command(name: str, plugin: Plugin, registry: Registry) -> None:
    if name in registry.commands:
        raise PluginError(
            f"the command '{name}' is registered already; rename it, or leave one plugin out with"
            f" OMNILAB_PLUGINS=-{plugin.name}"
        )


def _store(component: Component) -> None:
    kind = component.kind
    for name in filter(None, (component.name, component.formerly)):
        package = f"{MANY[kind]}.{name}" if kind in MANY else kind
        ConfigStore.instance().store(
            group=kind, name=name, node=_node(component.cls), package=package, provider=component.plugin.distribution
        )
