"""The study `changes`."""
