"""Recorded omnidirectional images as sensors, and recorded odometry."""

from omnilab import hookimpl
from omnilab.hooks import Register, RegisterCommand
from omnilab_recordings.checks.command import check
from omnilab_recordings.folder import Folder
from omnilab_recordings.recorded import Recorded

__all__ = ["Folder", "Recorded", "register_commands", "register_odometries", "register_sensors"]


@hookimpl
def register_sensors(register: Register) -> None:
    register("folder", Folder)


@hookimpl
def register_odometries(register: Register) -> None:
    register("recorded", Recorded)


@hookimpl
def register_commands(register: RegisterCommand) -> None:
    register("check", check)
