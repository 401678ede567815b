"""The study `view_range`."""
