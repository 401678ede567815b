"""SIFT (Lowe, 2004), compiled: the scale space, its extrema, their orientations and their vectors."""

from omnilab_appearance.common.sift.detection import sift

__all__ = ["sift"]
