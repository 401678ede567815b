"""The study `steps`."""
