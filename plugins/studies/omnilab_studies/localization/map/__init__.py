"""The study `map`."""
