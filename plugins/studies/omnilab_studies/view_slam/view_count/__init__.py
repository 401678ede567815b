"""The study `view_count`."""
