"""The study `views`."""
