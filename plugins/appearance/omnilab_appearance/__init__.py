"""Global-appearance descriptors, distances and localizers: all that numpy, scipy, numba and OpenCV can do."""

from omnilab.hooks import Register, hookimpl
from omnilab_appearance.euclidean import Euclidean
from omnilab_appearance.nearest import Nearest
from omnilab_appearance.poc import Poc
from omnilab_appearance.poc_band import PocBand
from omnilab_appearance.radon import Radon

__all__ = ["Euclidean", "Nearest", "Poc", "PocBand", "Radon"]


@hookimpl
def register_descriptors(register: Register) -> None:
    register("radon", Radon)


@hookimpl
def register_distances(register: Register) -> None:
    register("poc", Poc)
    register("poc_band", PocBand)
    register("euclidean", Euclidean)


@hookimpl
def register_localizers(register: Register) -> None:
    register("nearest", Nearest)
