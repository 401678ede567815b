"""Virtual worlds and cameras for omnilab."""

from __future__ import annotations

from omnilab import hookimpl
from omnilab.hooks import CommandIn, Register, RegisterCommand, RegisterFolder
from omnilab_mirror.sensors.lenses import (
    BrownConrady,
    Calibrated,
    Fisheye,
    KannalaBrandt,
    OCam,
    Pinhole,
    Stereo,
    Unified,
)
from omnilab_mirror.sensors.mirrors import Conical, Elliptic, Mirror, Parabolic, Spherical
from omnilab_mirror.sensors.panoramas import Cylindrical, Equirectangular

__all__ = [
    "BrownConrady",
    "Calibrated",
    "Conical",
    "Cylindrical",
    "Elliptic",
    "Equirectangular",
    "Fisheye",
    "KannalaBrandt",
    "Mirror",
    "OCam",
    "Parabolic",
    "Pinhole",
    "Spherical",
    "Stereo",
    "Unified",
]


@hookimpl
def register_sensors(register: Register) -> None:
    register("mirror", Mirror)
    register("parabolic", Parabolic)
    register("spherical", Spherical)
    register("elliptic", Elliptic)
    register("conical", Conical)
    register("unified", Unified)
    register("ocam", OCam)
    register("calibrated", Calibrated)
    register("pinhole", Pinhole)
    register("stereo", Stereo)
    register("fisheye", Fisheye)
    register("kannala_brandt", KannalaBrandt)
    register("brown_conrady", BrownConrady)
    register("cylindrical", Cylindrical)
    register("equirectangular", Equirectangular)


@hookimpl
def register_commands(register: RegisterCommand) -> None:
    register("world", CommandIn("omnilab_mirror.commands", "world_command"))


@hookimpl
def register_folders(register: RegisterFolder) -> None:
    register(".")
