"""Hands the records of a run to its sinks."""

from omnilab.runner.recorder.recorder import Recorder

__all__ = ["Recorder"]
