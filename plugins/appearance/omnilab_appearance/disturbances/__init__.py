"""Disturbances."""
