"""Camera models: for each, the ray of a pixel and the pixel of a ray; their files, and images of one seen by another."""

from omnilab.cameras.base import (
    CentralCamera,
    CylindricalCamera,
    EquirectangularCamera,
    ImageCircle,
    RayCamera,
    polar_pixels,
)
from omnilab.cameras.brown_conrady import BrownConradyCamera
from omnilab.cameras.dual_fisheye import DualFisheyeCamera
from omnilab.cameras.files import load_camera, save_camera
from omnilab.cameras.kannala_brandt import KannalaBrandtCamera
from omnilab.cameras.lenses import FisheyeCamera, PinholeCamera, UnifiedCamera
from omnilab.cameras.mirrors import EIZOH_WIDE_70, THESIS_HALF, THESIS_WHOLE, HyperbolicMirror, ParabolicMirror
from omnilab.cameras.noncentral import ConicalMirror, EllipticMirror, SphericalMirror
from omnilab.cameras.ocam import OCamCamera
from omnilab.cameras.reproject import birds_eye, reproject
from omnilab.cameras.stereo import StereoCamera

__all__ = [
    "EIZOH_WIDE_70",
    "THESIS_HALF",
    "THESIS_WHOLE",
    "BrownConradyCamera",
    "CentralCamera",
    "ConicalMirror",
    "CylindricalCamera",
    "DualFisheyeCamera",
    "EllipticMirror",
    "EquirectangularCamera",
    "FisheyeCamera",
    "HyperbolicMirror",
    "ImageCircle",
    "KannalaBrandtCamera",
    "OCamCamera",
    "ParabolicMirror",
    "PinholeCamera",
    "RayCamera",
    "SphericalMirror",
    "StereoCamera",
    "UnifiedCamera",
    "birds_eye",
    "load_camera",
    "polar_pixels",
    "reproject",
    "save_camera",
]
