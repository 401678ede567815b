"""Appearance-based descriptors, distances, localizers, altimeters, odometry, loop closures and image disturbances.

Each folder imports its components; all of them are registered, and importable from here.
"""

from typing import Any

from omnilab import renamed
from omnilab.hooks import Accelerator, Register, RegisterDevice, hookimpl, register_all
from omnilab_appearance import (
    altimeters,
    descriptors,
    distances,
    disturbances,
    localizers,
    loop_closures,
    odometries,
)
from omnilab_appearance.altimeters import *
from omnilab_appearance.descriptors import *
from omnilab_appearance.distances import *
from omnilab_appearance.disturbances import *
from omnilab_appearance.localizers import *
from omnilab_appearance.loop_closures import *
from omnilab_appearance.loop_closures.no_loop_closure import NoLoopClosure
from omnilab_appearance.odometries import *


@hookimpl
def register_disturbances(register: Register) -> None:
    register_all(register, disturbances)


@hookimpl
def register_descriptors(register: Register) -> None:
    register_all(register, descriptors)


@hookimpl
def register_distances(register: Register) -> None:
    register_all(register, distances)


@hookimpl
def register_localizers(register: Register) -> None:
    register_all(register, localizers, formerly={"bayes_filter": "filter"})


@hookimpl
def register_altimeters(register: Register) -> None:
    register_all(register, altimeters)


@hookimpl
def register_odometries(register: Register) -> None:
    register_all(register, odometries)


@hookimpl
def register_loop_closures(register: Register) -> None:
    register_all(register, loop_closures, formerly={"geometric_verification": "verified"})
    register("none", NoLoopClosure)


@hookimpl
def register_devices(register: RegisterDevice) -> None:
    register("cuda", _open_device)
    register("torch", _open_device)  # torch:cpu, to try what runs on a GPU where there is none


def _open_device(name: str) -> Accelerator:
    from omnilab_appearance.accelerated.torch_device import open_device

    return open_device(name)


def __getattr__(name: str) -> Any:
    """Names of the version before."""
    return renamed.attribute(__name__, name, {"Filter": "BayesFilter", "Verified": "GeometricVerification"})
