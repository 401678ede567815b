"""The study `localize`."""
