"""Hands the records of a run to its sinks."""

from omnilab.runner.recorder.progress_file import ProgressFile
from omnilab.runner.recorder.recorder import Recorder

__all__ = ["ProgressFile", "Recorder"]
