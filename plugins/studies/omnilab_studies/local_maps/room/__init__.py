"""The study `room`."""
