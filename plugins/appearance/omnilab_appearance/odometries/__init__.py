"""Odometries."""
