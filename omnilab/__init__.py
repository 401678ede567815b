"""Experiments in omnidirectional vision: the names a plugin author needs."""

from omnilab.api import Frames, Match, Metric, Report, Signatures
from omnilab.hooks import hookimpl

__all__ = ["Frames", "Match", "Metric", "Report", "Signatures", "hookimpl"]
__version__ = "0.1.0"
