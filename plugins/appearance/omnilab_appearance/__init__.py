"""Global-appearance descriptors, distances, localizers and altimeters, and disturbances: all that numpy, scipy, numba and OpenCV can do."""

from omnilab.hooks import Register, hookimpl
from omnilab_appearance.altimeters.feature_altitude import FeatureAltitude
from omnilab_appearance.altimeters.floor_and_walls import FloorAndWalls
from omnilab_appearance.altimeters.radon_compression import RadonCompression
from omnilab_appearance.descriptors.fourier_signature import FourierSignature
from omnilab_appearance.descriptors.gist import Gist
from omnilab_appearance.descriptors.hog import Hog
from omnilab_appearance.descriptors.onnx import Onnx
from omnilab_appearance.descriptors.radon import Radon
from omnilab_appearance.descriptors.radon_gist import RadonGist
from omnilab_appearance.descriptors.radon_hog import RadonHog
from omnilab_appearance.descriptors.ring import Ring
from omnilab_appearance.descriptors.ring_key import RingKey
from omnilab_appearance.descriptors.rotational_pca import RotationalPca
from omnilab_appearance.descriptors.sift import Sift
from omnilab_appearance.descriptors.surf import Surf
from omnilab_appearance.descriptors.tiny_image import TinyImage
from omnilab_appearance.distances.cosine import Cosine
from omnilab_appearance.distances.euclidean import Euclidean
from omnilab_appearance.distances.features import Features, FeaturesTurned
from omnilab_appearance.distances.log_distance import Log
from omnilab_appearance.distances.pearson import Pearson
from omnilab_appearance.distances.poc import Poc
from omnilab_appearance.distances.poc_band import PocBand
from omnilab_appearance.distances.poc_squared import PocSquared
from omnilab_appearance.distances.root import Root
from omnilab_appearance.distances.weighted import Cityblock, Weighted
from omnilab_appearance.disturbances.blur import Blur
from omnilab_appearance.disturbances.color_shift import ColorShift
from omnilab_appearance.disturbances.light import Light
from omnilab_appearance.disturbances.noise import GaussianNoise, ListingNoise, UniformNoise
from omnilab_appearance.disturbances.occlusion import Occlusion
from omnilab_appearance.disturbances.tilt import Tilt
from omnilab_appearance.localizers.bayes_filter import Filter
from omnilab_appearance.localizers.hierarchical import Hierarchical
from omnilab_appearance.localizers.interpolated import Interpolated
from omnilab_appearance.localizers.nearest import Nearest
from omnilab_appearance.localizers.smacof import Smacof
from omnilab_appearance.localizers.spring import Spring
from omnilab_appearance.loop_closures.geometric_verification import Verified
from omnilab_appearance.loop_closures.hog_threshold import HogThreshold
from omnilab_appearance.odometries.appearance import Appearance
from omnilab_appearance.odometries.appearance_fit import AppearanceFit
from omnilab_appearance.odometries.planar_epipolar import PlanarEpipolar
from omnilab_appearance.odometries.simulated import Simulated

__all__ = [
    "Appearance",
    "AppearanceFit",
    "Blur",
    "Cityblock",
    "ColorShift",
    "Cosine",
    "Euclidean",
    "FeatureAltitude",
    "Features",
    "FeaturesTurned",
    "Filter",
    "FloorAndWalls",
    "FourierSignature",
    "GaussianNoise",
    "Gist",
    "Hierarchical",
    "Hog",
    "HogThreshold",
    "Interpolated",
    "Light",
    "ListingNoise",
    "Log",
    "Nearest",
    "Occlusion",
    "Onnx",
    "Pearson",
    "PlanarEpipolar",
    "Poc",
    "PocBand",
    "PocSquared",
    "Radon",
    "RadonCompression",
    "RadonGist",
    "RadonHog",
    "Ring",
    "RingKey",
    "Root",
    "RotationalPca",
    "Sift",
    "Simulated",
    "Smacof",
    "Spring",
    "Surf",
    "Tilt",
    "TinyImage",
    "UniformNoise",
    "Verified",
    "Weighted",
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
    register("radon_gist", RadonGist)
    register("radon_hog", RadonHog)
    register("fourier_signature", FourierSignature)
    register("hog", Hog)
    register("gist", Gist)
    register("rotational_pca", RotationalPca)
    register("onnx", Onnx)
    register("sift", Sift)
    register("surf", Surf)
    register("ring", Ring)
    register("ring_key", RingKey)
    register("tiny_image", TinyImage)


@hookimpl
def register_distances(register: Register) -> None:
    register("poc", Poc)
    register("poc_band", PocBand)
    register("poc_squared", PocSquared)
    register("euclidean", Euclidean)
    register("cityblock", Cityblock)
    register("weighted", Weighted)
    register("pearson", Pearson)
    register("cosine", Cosine)
    register("log", Log)
    register("root", Root)
    register("features", Features)
    register("features_turned", FeaturesTurned)


@hookimpl
def register_localizers(register: Register) -> None:
    register("nearest", Nearest)
    register("filter", Filter)
    register("spring", Spring)
    register("smacof", Smacof)
    register("interpolated", Interpolated)
    register("hierarchical", Hierarchical)


@hookimpl
def register_altimeters(register: Register) -> None:
    register("radon_compression", RadonCompression)
    register("feature_altitude", FeatureAltitude)
    register("floor_and_walls", FloorAndWalls)


@hookimpl
def register_odometries(register: Register) -> None:
    register("appearance", Appearance)
    register("appearance_fit", AppearanceFit)
    register("planar_epipolar", PlanarEpipolar)
    register("simulated", Simulated)


@hookimpl
def register_loop_closures(register: Register) -> None:
    register("hog_threshold", HogThreshold)
    register("verified", Verified)
