"""Descriptors and distances compared: cost, robustness, resolution, linearity."""
