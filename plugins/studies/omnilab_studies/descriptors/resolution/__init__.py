"""The study `resolution`."""
