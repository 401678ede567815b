"""Finds plugins, checks what they register, and puts it into Hydra's ConfigStore.

Plugins are loaded one by one, each with a manager of its own: a broken one becomes a `Failure` and never stops the
others. The environment variable ``OMNILAB_PLUGINS`` is a comma-separated list: a path ``file.py`` loads that file
besides the installed plugins, ``-name`` leaves a plugin out (the name may be that of its distribution), ``none`` leaves
all installed ones out but for those that are named.
"""

from __future__ import annotations

import os
import re
import shlex
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import Distribution, EntryPoint, PackageNotFoundError, distributions, entry_points, requires
from pathlib import Path
from types import ModuleType
from typing import Any

import pluggy
from hydra.core.config_store import ConfigNode, ConfigStore
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from omnilab import hooks, renamed
from omnilab.api import KINDS
from omnilab.errors import ConfigError, PluginError, did_you_mean
from omnilab.hooks import COMMANDS_HOOK
from omnilab.runner.interrupts import interrupted, noticed, uninterrupted
from omnilab.runner.plugin_files import VARIABLE, chosen_plugins, file_of, load_file
from omnilab.runner.repair import RunsOnDisk
from omnilab.runner.terminal import print_error

DICTS = {kind.plural: kind.name for kind in KINDS.values() if kind.many}  # settings of a run that hold any number
MANY = {kind.name: kind.plural for kind in KINDS.values() if not kind.slot}  # `disturbance=blur` goes to the dict
HOOKS = {kind.name: kind.hook for kind in KINDS.values()}
DAMAGED = (ValueError, TypeError, KeyError, AttributeError, OSError)  # what reading the metadata of one raises


@dataclass(frozen=True)
class Plugin:
    """Where components come from."""

    name: str
    distribution: str
    version: str
    load: Callable[[], ModuleType] = field(compare=False)
    word: str = ""  # that names it in OMNILAB_PLUGINS, and no other

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

    @property
    def title(self) -> str:
        return f"{self.kind} '{self.name}' of {self.plugin.title}"


@dataclass(frozen=True)
class Failure:
    """A plugin that could not be used, and why."""

    plugin: Plugin
    error: BaseException

    @property
    def sentence(self) -> str:
        cause = " ".join(str(self.error).split())
        if not isinstance(self.error, PluginError):
            cause = f"{type(self.error).__name__}: {cause}".removesuffix(": ")
        return f"{self.plugin.title} not loaded: {cause}"

    @property
    def traceback(self) -> str:
        return "".join(traceback.format_exception(self.error))


@dataclass
class Registry:
    """All components there are, and the plugins that failed."""

    components: dict[tuple[str, str], Component] = field(default_factory=dict)
    commands: dict[str, hooks.Command] = field(default_factory=dict)
    commanders: dict[str, Plugin] = field(default_factory=dict)  # by command, the plugin that it comes from
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
        return sentence + did_you_mean(name, names, f"{kind}=") + self.failed

    @property
    def failed(self) -> str:
        """For the end of a sentence about a name that is not there: the plugins that failed, which may have it."""
        names = ", ".join(failure.plugin.name for failure in self.failures)
        return f"; not loaded: {names} (omnilab plugins -v says why)" if names else ""

    def of(self, instance: Any) -> Component | None:
        """Under which name an instance's class is registered."""
        return next((c for c in self.components.values() if c.cls is type(instance)), None)

    def title_of(self, kind: str, instance: Any) -> str:
        """How sentences name a component: by its plugin, or by its class where it is registered by none."""
        component = self.of(instance)
        return component.title if component else f"{kind} {type(instance).__name__}"


def discover(select: str | None = None) -> Registry:
    """Load every plugin, register what is sound, and store it for Hydra."""
    chosen = chosen_plugins() if select is None else [word for word in select.split(",") if word]
    registry = Registry()
    with uninterrupted():
        for plugin in _plugins(chosen):
            try:
                with noticed(partial(_say_slow, plugin, chosen)):
                    _add(plugin, registry, chosen)
            except BaseException as error:  # what a plugin does wrong, or raises to end us, must not stop the others
                if interrupted():
                    raise KeyboardInterrupt from error
                registry.failures.append(Failure(plugin, error))
    return registry


def _say_slow(plugin: Plugin, chosen: Sequence[str]) -> None:
    print_error(
        f"{plugin.title} is still being imported; Ctrl-C ends this, and {_without(plugin, chosen)} leaves it out"
    )


def _add(plugin: Plugin, registry: Registry, chosen: Sequence[str]) -> None:
    """Load a plugin, and take what it registers where all of it is sound."""
    components, commands = _load(plugin, registry)
    taken = [
        (f"{c.kind} '{c.name}'", registry.components[c.kind, c.name].plugin)
        for c in components
        if (c.kind, c.name) in registry.components
    ]
    taken += [(f"the command '{name}'", registry.commanders[name]) for name in commands if name in registry.commanders]
    for what, other in taken:
        raise PluginError(
            f"{what} is registered already by {other.title}; rename it, or leave one plugin out with"
            f" {_without(plugin, chosen)}"
        )
    for component in components:
        _store(component)
    registry.components.update({(c.kind, c.name): c for c in components})
    registry.formerly.update({(c.kind, c.formerly): c.name for c in components if c.formerly})
    registry.commands.update(commands)
    registry.commanders.update(dict.fromkeys(commands, plugin))


def _without(plugin: Plugin, chosen: Sequence[str]) -> str:
    """The variable as it is, but without one plugin."""
    named = plugin.word in chosen
    rest = [word for word in chosen if word != plugin.word] if named else [*chosen, f"-{plugin.word}"]
    return f"{VARIABLE}={shlex.quote(','.join(rest))}"


def _plugins(chosen: Sequence[str]) -> Iterator[Plugin]:
    """Installed plugins, those of omnilab[all] first so that no other can take their names; then single files."""
    own, (points, found) = _own_distributions(), _entry_points()
    count = Counter(point.name for point in points)
    for point in points:
        name, version = _named(point.dist)
        found.append(Plugin(point.name, name, version, point.load, point.name if count[point.name] == 1 else name))
    found.sort(key=lambda p: (p.distribution not in own, p.distribution, p.name))
    files = {os.path.realpath(file): (file, word) for word in chosen if (file := file_of(word))}  # each once
    found += [Plugin(file.stem, word, "", partial(load_file, file), word) for file, word in files.values()]
    known = {name for plugin in found for name in (plugin.name, plugin.distribution)}
    for word in chosen:
        if word != "none" and word.removeprefix("-") not in known and file_of(word) is None:
            raise ConfigError(
                f"{VARIABLE} names '{word}', which is no plugin; give file.py, none, or - and one of "
                + ", ".join(plugin.name for plugin in found)
            )
    left_out = {word.removeprefix("-") for word in chosen if word.startswith("-")}
    for plugin in found:
        names = {plugin.name, plugin.distribution}
        if not names & left_out and ("none" not in chosen or names & set(chosen)):
            yield plugin


def _entry_points() -> tuple[list[EntryPoint], list[Plugin]]:
    """Those of installed plugins; and as plugins that fail, the distributions that do not let themselves be read."""
    try:
        return list(entry_points(group="omnilab")), []
    except DAMAGED:  # one is damaged, and must not hide the others
        found: list[EntryPoint] = []
        failing: list[Plugin] = []
        seen: set[str] = set()
        for distribution in distributions():
            name, _ = _named(distribution)
            if name in seen:  # what is installed as its source is there twice
                continue
            seen |= {name} - {"?"}
            try:
                found += distribution.entry_points.select(group="omnilab")
            except DAMAGED as error:
                folder = Path(str(getattr(distribution, "_path", "?"))).name
                failing.append(Plugin(folder, name, "", partial(_fail, error), folder))
        return found, failing


def _fail(error: Exception) -> ModuleType:
    raise PluginError(f"what it says of itself cannot be read ({type(error).__name__}); install it anew") from error


def _named(distribution: Distribution | None) -> tuple[str, str]:
    """Name and version, "?" and "" where a distribution does not say."""
    try:
        return (distribution.name or "?", distribution.version or "") if distribution else ("?", "")
    except DAMAGED:  # its metadata is no text
        return "?", ""


def _own_distributions() -> set[str]:
    try:
        wanted = requires("omnilab") or []
    except PackageNotFoundError:  # run from a source tree that was never installed
        return set()
    return {"omnilab"} | {re.split(r"[ ;<>=!~\[]", line)[0] for line in wanted if line.startswith("omnilab-")}


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
            f"{kind} '{name}' ({cls.__name__}) has the field '{error.full_key}' of a type that no setting can have"
            f" ({_type_of(cls, str(error.full_key))}); use bool, int, float, str, Path, Enum, list, dict, X | None or a"
            " nested dataclass"
        ) from error
    return note


def _type_of(cls: type[Any], field_name: str) -> str:
    """As the class declares it."""
    found = cls.__dataclass_fields__.get(field_name)
    return "unknown" if found is None else getattr(found.type, "__name__", None) or str(found.type)


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


def _store(component: Component) -> None:
    """Put a class where Hydra finds it, as `ConfigStore.store` does, which would copy its node first."""
    kind, store = component.kind, ConfigStore.instance()
    vars(store)["__deepcopy__"] = _uncopied
    for name in filter(None, (component.name, component.formerly)):
        package = f"{MANY[kind]}.{name}" if kind in MANY else kind
        node = ConfigNode(f"{name}.yaml", _node(component.cls), kind, package, component.plugin.distribution)
        store.repo.setdefault(kind, {})[node.name] = node


def _uncopied(_: object) -> ConfigStore:
    """The store instead of a copy of all of it, two of which Hydra makes a start; it copies each node that it takes."""
    return ConfigStore.instance()
