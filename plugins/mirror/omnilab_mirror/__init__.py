"""Virtual worlds and mirror cameras for omnilab."""

from __future__ import annotations

from omnilab import hookimpl
from omnilab.hooks import Register, RegisterCommand
from omnilab_mirror.commands import world_command
from omnilab_mirror.mirror import Mirror

__all__ = ["Mirror"]


@hookimpl
def register_sensors(register: Register) -> None:
    register("mirror", Mirror)


@hookimpl
def register_commands(register: RegisterCommand) -> None:
    register("world", world_command)
