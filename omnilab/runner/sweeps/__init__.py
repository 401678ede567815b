"""Sweeps: their folders, the life of their jobs, and how they go on after an interruption."""

from omnilab.runner.sweeps.state import Job as Job
from omnilab.runner.sweeps.state import LoadedSweep as LoadedSweep
from omnilab.runner.sweeps.state import load_sweep as load_sweep
