"""Textures of the surfaces of a world."""
