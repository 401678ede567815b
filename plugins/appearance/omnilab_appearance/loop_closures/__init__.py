"""Loop-closure detectors."""

from omnilab_appearance.loop_closures.geometric_verification import GeometricVerification as GeometricVerification
from omnilab_appearance.loop_closures.hog_threshold import HogThreshold as HogThreshold
