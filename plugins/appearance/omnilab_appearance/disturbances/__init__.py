"""Image disturbances.

What is imported here is registered, by the name of its class in snake case.
"""

from omnilab_appearance.disturbances.blur import Blur as Blur
from omnilab_appearance.disturbances.color_shift import ColorShift as ColorShift
from omnilab_appearance.disturbances.light import Light as Light
from omnilab_appearance.disturbances.noise import GaussianNoise as GaussianNoise
from omnilab_appearance.disturbances.noise import ListingNoise as ListingNoise
from omnilab_appearance.disturbances.noise import UniformNoise as UniformNoise
from omnilab_appearance.disturbances.occlusion import Occlusion as Occlusion
from omnilab_appearance.disturbances.tilt import Tilt as Tilt
from omnilab_appearance.disturbances.upright_adjustment import UprightAdjustment as UprightAdjustment
