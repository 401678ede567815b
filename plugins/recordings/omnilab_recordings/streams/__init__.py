"""Recorded streams of images: what videos, bags and logs have in common."""
