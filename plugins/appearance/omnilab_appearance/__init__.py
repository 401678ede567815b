"""Global-appearance descriptors, distances and localizers, and disturbances: all that numpy, scipy, numba and OpenCV can do."""

from omnilab.hooks import Register, hookimpl
from omnilab_appearance.blur import Blur
from omnilab_appearance.color_shift import ColorShift
from omnilab_appearance.euclidean import Euclidean
from omnilab_appearance.light import Light
from omnilab_appearance.nearest import Nearest
from omnilab_appearance.noise import GaussianNoise, ListingNoise, UniformNoise
from omnilab_appearance.occlusion import Occlusion
from omnilab_appearance.poc import Poc
from omnilab_appearance.poc_band import PocBand
from omnilab_appearance.radon import Radon
from omnilab_appearance.tilt import Tilt

__all__ = [
    "Blur",
    "ColorShift",
    "Euclidean",
    "GaussianNoise",
    "Light",
    "ListingNoise",
    "Nearest",
    "Occlusion",
    "Poc",
    "PocBand",
    "Radon",
    "Tilt",
    "UniformNoise",
]


@hookimpl
def register_disturbances(register: Register) -> None:
    register("uniform_noise", UniformNoise)
    register("gaussian_noise", GaussianNoise)
    register("listing_noise", ListingNoise)
    register("occlusion", Occlusion)
    register("blur", Blur)
    register("light", Light)
    register("color_shift", ColorShift)
    register("tilt", Tilt)


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
