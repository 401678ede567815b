"""The study `render`."""
