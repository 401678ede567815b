"""Distances between signatures.

What is imported here is registered, by the name of its class in snake case.
"""

from omnilab_appearance.distances.circular_correlation import CircularCorrelation as CircularCorrelation
from omnilab_appearance.distances.cosine import Cosine as Cosine
from omnilab_appearance.distances.epipolar_rotation import EpipolarRotation as EpipolarRotation
from omnilab_appearance.distances.euclidean import Euclidean as Euclidean
from omnilab_appearance.distances.feature_rotation import FeatureRotation as FeatureRotation
from omnilab_appearance.distances.features import Features as Features
from omnilab_appearance.distances.features import FeaturesTurned as FeaturesTurned
from omnilab_appearance.distances.log_distance import Log as Log
from omnilab_appearance.distances.pearson import Pearson as Pearson
from omnilab_appearance.distances.poc import Poc as Poc
from omnilab_appearance.distances.poc_band import PocBand as PocBand
from omnilab_appearance.distances.poc_squared import PocSquared as PocSquared
from omnilab_appearance.distances.root import Root as Root
from omnilab_appearance.distances.rotational_difference import RotationalDifference as RotationalDifference
from omnilab_appearance.distances.so3_correlation import So3Correlation as So3Correlation
from omnilab_appearance.distances.weighted import Cityblock as Cityblock
from omnilab_appearance.distances.weighted import Weighted as Weighted
