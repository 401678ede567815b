"""Frames as they come: their pace, what becomes of late ones, and how long answers take."""
