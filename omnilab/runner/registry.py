"""Finds plugins, and checks what they register.

Plugins are loaded one by one, each with a manager of its own: a broken one becomes a `Failure` and never stops the
others. The environment variable ``OMNILAB_PLUGINS`` is a comma-separated list: a path ``file.py`` loads that file
besides the installed plugins, ``-name`` leaves a plugin out (the name may be that of its distribution), ``none`` leaves
all installed ones out but for those that are named.
"""

from __future__ import annotations

import re
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import pluggy

from omnilab import hooks, renamed
from omnilab.api import KINDS
from omnilab.errors import ConfigError, PluginError, did_you_mean
from omnilab.hooks import COMMANDS_HOOK, DEVICES_HOOK, FOLDERS_HOOK
from omnilab.runner.interrupts import interrupted, noticed, uninterrupted
from omnilab.runner.plugin_files import chosen_plugins
from omnilab.runner.plugins.contract import news_for
from omnilab.runner.plugins.finding import ITSELF, Plugin, plugins, without
from omnilab.runner.plugins.folders import Shipped, folder_of, own_recipes
from omnilab.runner.plugins.plain_settings import are_plain
from omnilab.runner.repair import RunsOnDisk
from omnilab.runner.terminal import print_error
from omnilab.shipped_worlds import ship_worlds

DICTS = {kind.plural: kind.name for kind in KINDS.values() if kind.many}  # settings of a run that hold any number
MANY = {kind.name: kind.plural for kind in KINDS.values() if not kind.slot}  # `disturbance=blur` goes to the dict
HOOKS = {kind.name: kind.hook for kind in KINDS.values()}
CPU = "cpu"  # the device that every run has
VALUES = {"null", "true", "false", "nan", "inf"}  # what Hydra reads as such
ALL_HOOKS = ", ".join([*HOOKS.values(), COMMANDS_HOOK, FOLDERS_HOOK, DEVICES_HOOK])


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


@dataclass(frozen=True)
class ShippedFile:
    """A recipe or a world."""

    file: Path
    plugin: Plugin


@dataclass
class Offer:
    """What one plugin registers."""

    components: dict[tuple[str, str], Component] = field(default_factory=dict)
    commands: dict[str, hooks.Command] = field(default_factory=dict)
    devices: dict[str, hooks.OpenDevice] = field(default_factory=dict)
    shipped: Shipped = field(default_factory=Shipped)

    def names(self) -> Iterator[tuple[str, str]]:
        """What no other plugin may register, in words; and the file that it is in, or ""."""
        yield from ((f"{kind} '{name}'", "") for kind, name in self.components)
        yield from ((f"the command '{name}'", "") for name in self.commands)
        yield from ((f"the device '{name}'", "") for name in self.devices)
        yield from ((f"the recipe '{name}'", f" ({file})") for name, file in self.shipped.recipes.items())
        yield from ((f"the world '{name}'", f" ({file})") for name, file in self.shipped.worlds.items())


@dataclass
class Registry:
    """All components there are, and the plugins that failed."""

    components: dict[tuple[str, str], Component] = field(default_factory=dict)
    commands: dict[str, hooks.Command] = field(default_factory=dict)
    devices: dict[str, hooks.OpenDevice] = field(default_factory=dict)  # beside the processor, by the name before the :
    taken: dict[str, Plugin] = field(default_factory=dict)  # by what it is and its name, where it comes from
    recipes: dict[str, ShippedFile] = field(default_factory=dict)
    worlds: dict[str, ShippedFile] = field(default_factory=dict)
    folders: dict[Path, Plugin] = field(default_factory=dict)  # of recipes and worlds, of plugins
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
        if all(known == "sink" for known, _ in self.components):  # omnilab alone was installed
            sentence += "; pip install 'omnilab[all]' brings the components, in a clone pip install . ./plugins/*"
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
    """Load every plugin, and register what is sound."""
    chosen = chosen_plugins() if select is None else [word for word in select.split(",") if word]
    registry = Registry()
    _take(Offer(shipped=Shipped(recipes=own_recipes())), ITSELF, registry)
    with uninterrupted():
        for plugin in plugins(chosen):
            try:
                with noticed(partial(_say_slow, plugin, chosen)):
                    _add(plugin, registry, chosen)
            except BaseException as error:  # what a plugin does wrong, or raises to end us, must not stop the others
                if interrupted():
                    raise KeyboardInterrupt from error
                registry.failures.append(Failure(plugin, error))
    ship_worlds({name: world.file for name, world in registry.worlds.items()})
    return registry


def _say_slow(plugin: Plugin, chosen: Sequence[str]) -> None:
    print_error(
        f"{plugin.title} is still being imported; Ctrl-C ends this, and {without(plugin, chosen)} leaves it out"
    )


def _add(plugin: Plugin, registry: Registry, chosen: Sequence[str]) -> None:
    """Load a plugin, and take what it registers where all of it is sound."""
    offer = _load(plugin, registry)
    for what, file in offer.names():
        if other := registry.taken.get(what):
            raise PluginError(
                f"{what}{file} is registered already by {other.title}; rename it, or leave one plugin out with"
                f" {without(plugin, chosen)}"
            )
    _take(offer, plugin, registry)


def _take(offer: Offer, plugin: Plugin, registry: Registry) -> None:
    registry.components.update(offer.components)
    registry.formerly.update({(c.kind, c.formerly): c.name for c in offer.components.values() if c.formerly})
    registry.commands.update(offer.commands)
    registry.devices.update(offer.devices)
    registry.recipes.update({name: ShippedFile(file, plugin) for name, file in offer.shipped.recipes.items()})
    registry.worlds.update({name: ShippedFile(file, plugin) for name, file in offer.shipped.worlds.items()})
    registry.folders.update(dict.fromkeys(offer.shipped.folders, plugin))
    registry.taken.update({what: plugin for what, _ in offer.names()})


def _load(plugin: Plugin, registry: Registry) -> Offer:
    """What one plugin registers, each checked. What has changed since it was written is noted, or said if it fails."""
    module = plugin.load()
    news = news_for(module)
    try:
        offer, notes = _registered(module, plugin, registry)
    except PluginError as error:
        if news:
            raise PluginError(f"{error}; {news}") from error
        raise
    registry.notes += [f"{plugin.title}: {note}" for note in ([news] if news else notes)]
    return offer


def _registered(module: ModuleType, plugin: Plugin, registry: Registry) -> tuple[Offer, list[str]]:
    """What a module registers, and the words in it of the version before."""
    manager = pluggy.PluginManager("omnilab")
    manager.add_hookspecs(hooks.hookspecs())
    manager.register(module, name=plugin.name)
    try:
        manager.check_pending()
    except pluggy.PluginValidationError as error:
        raise PluginError(f"{error}; the hooks are {ALL_HOOKS}") from error
    offer, notes = Offer(), list[str]()
    for kind, hook in HOOKS.items():

        def register(name: str, cls: type[Any], formerly: str = "", kind: str = kind) -> None:
            if note := check_component(kind, name, cls):
                notes.append(note)
            if known := offer.components.get((kind, name)):
                raise PluginError(f"{kind} '{name}' is registered twice, by {known.cls} and {cls}")
            offer.components[kind, name] = Component(kind, name, cls, plugin, formerly)

        getattr(manager.hook, hook)(register=register)

    manager.hook.register_commands(register=_into(offer.commands, "command"), runs=RunsOnDisk(registry))
    manager.hook.register_devices(register=_into(offer.devices, "device", CPU))
    manager.hook.register_folders(register=lambda folder: offer.shipped.add(folder_of(folder, module)))
    if not any(offer.names()):
        raise PluginError(f"it registers nothing; mark a function with @hookimpl, one of {ALL_HOOKS}")
    return offer, notes


def _into(functions: dict[str, Any], what: str, ours: str = "") -> Callable[[str, Any], None]:
    """What a plugin calls for each function that it registers by a name, which is not one of `ours`."""

    def register(name: str, function: Any) -> None:
        if not re.fullmatch(r"[a-z]+", name) or not callable(function) or name in {*functions, ours}:
            raise PluginError(
                f"{what} {name!r} is {function!r}; register one function for a name of lower case letters"
                + (f" other than {ours}" if ours else "")
            )
        functions[name] = function

    return register


def check_component(kind: str, name: str, cls: type[Any]) -> str:
    """PluginError if a class cannot serve as a component of that kind under that name.

    Returns what to write instead of a word of the version before, or "".
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise PluginError(f"{kind} '{name}' has an unusable name; use lower case letters, digits and _")
    if name in VALUES:
        raise PluginError(f"{kind} '{name}' cannot be chosen: {kind}={name} is read as a value; give it another name")
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
    if not are_plain(cls):
        _check_node(kind, name, cls)
    return note


def _check_node(kind: str, name: str, cls: type[Any]) -> None:
    """PluginError if OmegaConf can make no configuration of a class."""
    from omegaconf import OmegaConf  # which takes as long to import as half of the plugins
    from omegaconf.errors import OmegaConfBaseException

    try:
        OmegaConf.structured(cls)
    except OmegaConfBaseException as error:
        raise PluginError(
            f"{kind} '{name}' ({cls.__name__}) has the field '{error.full_key}' of a type that no setting can have"
            f" ({_type_of(cls, str(error.full_key))}); use bool, int, float, str, Path, Enum, list, dict, X | None or a"
            " nested dataclass"
        ) from error


def _type_of(cls: type[Any], field_name: str) -> str:
    """As the class declares it."""
    found = cls.__dataclass_fields__.get(field_name)
    return "unknown" if found is None else getattr(found.type, "__name__", None) or str(found.type)


def members(protocol: type[Any]) -> list[str]:
    """The attributes and methods that a Protocol asks for, those of the Protocols it extends first."""
    found: list[str] = []
    for cls in reversed(protocol.__mro__):
        if getattr(cls, "_is_protocol", False):
            offered = [n for n, value in vars(cls).items() if callable(value) or isinstance(value, property)]
            found += [name for name in [*cls.__annotations__, *offered] if not name.startswith("_")]
    return list(dict.fromkeys(found))
