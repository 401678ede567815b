"""Trajectories: alignment and errors; the readers and writers of their files."""
