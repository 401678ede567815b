"""The study `cost`."""
