"""The study `rotations`."""
