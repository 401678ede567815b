"""Loop-closure detectors.

What is imported here is registered, by the name of its class in snake case; `no_loop_closure` as `none`.
"""

from omnilab_appearance.loop_closures.geometric_verification import GeometricVerification as GeometricVerification
from omnilab_appearance.loop_closures.hog_threshold import HogNearest as HogNearest
from omnilab_appearance.loop_closures.hog_threshold import HogThreshold as HogThreshold
