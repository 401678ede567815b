"""Sweeps that are watched: their jobs, as records, as a grid and as a table."""

from omnilab_serve.sweeps.watched import WatchedSweeps as WatchedSweeps
