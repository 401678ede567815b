"""Pose graphs, optimised by several back ends."""
