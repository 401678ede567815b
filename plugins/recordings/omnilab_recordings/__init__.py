"""Recorded omnidirectional images as sensors."""

from omnilab import hookimpl
from omnilab.hooks import Register
from omnilab_recordings.folder import Folder

__all__ = ["Folder", "register_sensors"]


@hookimpl
def register_sensors(register: Register) -> None:
    register("folder", Folder)
