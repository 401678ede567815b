"""Pose graphs optimised by back ends."""
