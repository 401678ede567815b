"""Everything that can be extended, one hook per kind.

A plugin is a module with functions of these names, marked with ``@hookimpl``, that call ``register(name, cls)``::

    from omnilab import hookimpl

    @hookimpl
    def register_descriptors(register):
        register("mine", Mine)

and one entry point in the group ``omnilab`` that names the module. The component is a plain dataclass: its fields are
its configuration, its docstring is its manual. What each kind must offer is its Protocol in `omnilab.api`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pluggy

Register = Callable[[str, type[Any]], None]
Command = Callable[[list[str]], int]  # takes the arguments, returns the exit code
RegisterCommand = Callable[[str, Command], None]

hookspec = pluggy.HookspecMarker("omnilab")
hookimpl = pluggy.HookimplMarker("omnilab")


@hookspec
def register_sensors(register: Register) -> None:
    """Sources of images: virtual worlds, folders of pictures, logs played back."""


@hookspec
def register_disturbances(register: Register) -> None:
    """From images to spoilt ones: noise, occlusion, blur, another light."""


@hookspec
def register_descriptors(register: Register) -> None:
    """From images to signatures."""


@hookspec
def register_distances(register: Register) -> None:
    """From pairs of signatures to how unlike they are, and how far they are turned."""


@hookspec
def register_localizers(register: Register) -> None:
    """From a query and a map to a pose."""


@hookspec
def register_altimeters(register: Register) -> None:
    """From two images to the difference of their heights."""


@hookspec
def register_odometries(register: Register) -> None:
    """From two images to the motion between them."""


@hookspec
def register_loop_closures(register: Register) -> None:
    """From an image to the places on the robot's way that it shows again."""


@hookspec
def register_backends(register: Register) -> None:
    """From a pose graph to its optimum."""


@hookspec
def register_view_filters(register: Register) -> None:
    """From odometry and views seen again to a map of views."""


@hookspec
def register_studies(register: Register) -> None:
    """Experiments' code: drives the components and measures."""


@hookspec
def register_sinks(register: Register) -> None:
    """Where the records of a run go."""


@hookspec
def register_commands(register: RegisterCommand) -> None:
    """Commands beside experiments, `omnilab NAME ...`: here a function is registered, not a component."""
