"""The study `large_map`."""
