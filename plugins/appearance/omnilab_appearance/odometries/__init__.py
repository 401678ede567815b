"""Visual and simulated odometry.

What is imported here is registered, by the name of its class in snake case.
"""

from omnilab_appearance.odometries.appearance import Appearance as Appearance
from omnilab_appearance.odometries.appearance_fit import AppearanceFit as AppearanceFit
from omnilab_appearance.odometries.guided_epipolar import GuidedEpipolar as GuidedEpipolar
from omnilab_appearance.odometries.planar_epipolar import PlanarEpipolar as PlanarEpipolar
from omnilab_appearance.odometries.simulated import Simulated as Simulated
