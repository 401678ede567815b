"""The study `robustness`."""
