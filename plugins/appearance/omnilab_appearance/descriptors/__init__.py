"""Global-appearance and local-feature descriptors.

What is imported here is registered, by the name of its class in snake case.
"""

from omnilab_appearance.descriptors.fourier_phase import FourierPhase as FourierPhase
from omnilab_appearance.descriptors.fourier_signature import FourierSignature as FourierSignature
from omnilab_appearance.descriptors.gist import Gist as Gist
from omnilab_appearance.descriptors.grids.gist_grid import GistGrid as GistGrid
from omnilab_appearance.descriptors.grids.hog_grid import HogGrid as HogGrid
from omnilab_appearance.descriptors.grids.radon_gist_grid import RadonGistGrid as RadonGistGrid
from omnilab_appearance.descriptors.grids.radon_hog_grid import RadonHogGrid as RadonHogGrid
from omnilab_appearance.descriptors.hog import Hog as Hog
from omnilab_appearance.descriptors.onnx import Onnx as Onnx
from omnilab_appearance.descriptors.radon import Radon as Radon
from omnilab_appearance.descriptors.radon_gist import RadonGist as RadonGist
from omnilab_appearance.descriptors.radon_hog import RadonHog as RadonHog
from omnilab_appearance.descriptors.ring import Ring as Ring
from omnilab_appearance.descriptors.ring_key import RingKey as RingKey
from omnilab_appearance.descriptors.rotational_pca import RotationalPca as RotationalPca
from omnilab_appearance.descriptors.sift import Sift as Sift
from omnilab_appearance.descriptors.spherical_harmonics import SphericalHarmonics as SphericalHarmonics
from omnilab_appearance.descriptors.spherical_power import SphericalPower as SphericalPower
from omnilab_appearance.descriptors.spherical_sift import SphericalSift as SphericalSift
from omnilab_appearance.descriptors.surf import Surf as Surf
from omnilab_appearance.descriptors.tiny_image import TinyImage as TinyImage
