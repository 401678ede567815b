"""Altimeters: the difference in height of two images.

What is imported here is registered, by the name of its class in snake case.
"""

from omnilab_appearance.altimeters.feature_altitude import FeatureAltitude as FeatureAltitude
from omnilab_appearance.altimeters.floor_and_walls import FloorAndWalls as FloorAndWalls
from omnilab_appearance.altimeters.radon_compression import RadonCompression as RadonCompression
