"""The study `lifelong_map`."""
