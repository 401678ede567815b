"""The study `joint`."""
