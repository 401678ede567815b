"""Recorded omnidirectional images as sensors."""

from omnilab import hookimpl
from omnilab.hooks import Register, RegisterCommand
from omnilab_recordings.command import check
from omnilab_recordings.folder import Folder

__all__ = ["Folder", "register_commands", "register_sensors"]


@hookimpl
def register_sensors(register: Register) -> None:
    register("folder", Folder)


@hookimpl
def register_commands(register: RegisterCommand) -> None:
    register("check", check)
