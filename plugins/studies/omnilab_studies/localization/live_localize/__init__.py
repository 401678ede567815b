"""The study `live_localize`."""
