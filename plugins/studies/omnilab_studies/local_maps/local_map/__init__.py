"""The study `local_map`."""
