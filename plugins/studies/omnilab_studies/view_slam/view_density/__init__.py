"""The study `view_density`."""
