"""Altimeters."""
