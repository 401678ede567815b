"""The study `topological_map`."""
