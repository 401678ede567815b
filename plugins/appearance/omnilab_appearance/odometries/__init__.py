"""Visual and simulated odometry."""

from omnilab_appearance.odometries.appearance import Appearance as Appearance
from omnilab_appearance.odometries.appearance_fit import AppearanceFit as AppearanceFit
from omnilab_appearance.odometries.planar_epipolar import PlanarEpipolar as PlanarEpipolar
from omnilab_appearance.odometries.simulated import Simulated as Simulated
