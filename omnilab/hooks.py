"""The hooks by which plugins extend omnilab: one for each kind of component, for commands, for folders, for devices.

A plugin is a module with functions named ``register_`` and the plural of a kind, marked with ``@hookimpl``, that call
``register(name, cls)``::

    from omnilab import hookimpl

    @hookimpl
    def register_descriptors(register):
        register("mine", Mine)

and one entry point in the group ``omnilab`` that names the module. The component is a plain dataclass: its fields are
its configuration, its docstring is its manual. The kinds are those of `omnilab.api.KINDS`; what each must offer is its
Protocol there.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, is_dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol

import pluggy

from omnilab.api import KINDS, Kind

COMMANDS_HOOK = "register_commands"
FOLDERS_HOOK = "register_folders"
DEVICES_HOOK = "register_devices"

Command = Callable[[list[str]], int]  # takes the arguments, returns the exit code
RegisterCommand = Callable[[str, Command], None]
RegisterFolder = Callable[[str | Path], None]
OpenDevice = Callable[[str], "Accelerator"]  # takes what a run was given, `cuda:1`; ConfigError if it cannot be had
RegisterDevice = Callable[[str, OpenDevice], None]

hookspec = pluggy.HookspecMarker("omnilab")
hookimpl = pluggy.HookimplMarker("omnilab")


@dataclass(frozen=True)
class CommandIn:
    """The command of that name in a module, which is imported when the command is given: other commands start without."""

    module: str
    name: str

    def load(self) -> Command:
        """The command itself."""
        found: Command = getattr(import_module(self.module), self.name)
        return found

    def __call__(self, argv: list[str]) -> int:
        return self.load()(argv)


class Register(Protocol):
    """What a plugin calls for each of its components."""

    def __call__(self, name: str, cls: type[Any], formerly: str = "") -> None:
        """Register a class under a name; `formerly` is the one it had, which goes on working for a while."""


class Accelerator(Protocol):
    """A device beside the processor, opened for a run, that computes what some components do."""

    @property
    def computed_on(self) -> str:
        """The device, its library and version: what the last bits of a result depend on. For manifests and cache keys."""

    def accelerated(self, component: Any) -> Any | None:
        """One of the same settings that computes there, of a class derived from the component's; None where there is none.

        Its results are those of the component but for rounding, and come back as NumPy's arrays.
        """


def register_all(register: Register, package: ModuleType, formerly: Mapping[str, str] | None = None) -> None:
    """Register every dataclass that a package imports, in that order, by its name in snake case.

    `formerly` has, by these names, the ones that components had before.
    """
    for cls in vars(package).values():
        if isinstance(cls, type) and is_dataclass(cls):
            name = snake_case(cls.__name__)
            register(name, cls, (formerly or {}).get(name, ""))


def snake_case(name: str) -> str:
    """The registered name of a class: `RadonHog` as `radon_hog`."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


@dataclass(frozen=True)
class RunSummary:
    """What a run's folder says of it. What is not there, or damaged, is empty."""

    folder: Path
    state: str  # running, done, failed, interrupted, killed or silent
    experiment: str = ""
    overrides: Sequence[str] = ()
    components: Mapping[str, str] = field(default_factory=dict)  # by slot, such as `descriptor`, the registered name
    config: Mapping[str, Any] = field(default_factory=dict)  # all settings as they ran
    metrics: Mapping[str, float] = field(default_factory=dict)
    header: str = ""  # how it stands now, in Markdown: see `omnilab.run_header`


class Runs(Protocol):
    """The runs on disk, for commands of plugins."""

    def ready(self, run: Path) -> Path:
        """The folder of a run, its logs mended first if it was killed; DataError if there is none.

        Of a run that goes on, or may, that of a mended copy, which is taken away when the command ends.
        """

    def summary(self, run: Path) -> RunSummary:
        """What a run's folder says of it; DataError if there is none."""


def hookspecs() -> type[Any]:
    """The specifications of all hooks, for pluggy."""
    specified = {kind.hook: _of_kind(kind) for kind in KINDS.values()}
    more = {COMMANDS_HOOK: hookspec(register_commands), FOLDERS_HOOK: hookspec(register_folders)}
    more[DEVICES_HOOK] = hookspec(register_devices)
    return type("Hooks", (), specified | more)


def _of_kind(kind: Kind) -> Any:
    def register_components(register: Register) -> None: ...

    register_components.__name__, register_components.__doc__ = kind.hook, kind.summary
    return hookspec(register_components)


def register_commands(register: RegisterCommand, runs: Runs) -> None:
    """Commands beside experiments, `omnilab NAME ...`: here a function is registered, not a component.

    `register("mine", CommandIn("my_package.my_command", "mine"))` keeps its module, and what that imports, out of the start
    of every other command.
    """


def register_folders(register: RegisterFolder) -> None:
    """Folders of recipes and worlds: a path is registered, relative to the plugin's module or absolute.

    `experiment/NAME.yaml` in it runs as `experiment=NAME`, `worlds/NAME.yaml` is found as `sensor.world=NAME`.
    """


def register_devices(register: RegisterDevice) -> None:
    """Devices on which a run may compute: `register("cuda", open_cuda)` serves `device=cuda` and `device=cuda:1`.

    `open_cuda` is called when such a run begins: a library that it needs is imported then, and by no other run.
    """
